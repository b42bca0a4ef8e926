//! Rivals run as processes that print their trials and can be ended.

use std::fs::{self, File};
use std::io;
use std::path::Path;
use std::process::{Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use crate::Trial;

/// What became of a rival.
#[derive(Debug)]
pub(crate) enum Verdict {
    /// Its first trial that keeps the tolerance.
    Kept(Trial),
    /// None did; why, in a few words.
    Missed(String),
}

/// Runs a rival for at most `limit` seconds and takes its last trial.
///
/// # Errors
/// If it can't be started.
pub(crate) fn run(
    command: &mut Command,
    folder: &Path,
    tolerance: f64,
    limit: f64,
) -> io::Result<Verdict> {
    let output = folder.join("trials");
    let mut child = command.stdout(File::create(&output)?).stderr(Stdio::inherit()).spawn()?;
    let start = Instant::now();
    let status = loop {
        if let Some(status) = child.try_wait()? {
            break Some(status);
        }
        if start.elapsed().as_secs_f64() > limit {
            child.kill()?;
            child.wait()?;
            break None;
        }
        sleep(Duration::from_millis(20));
    };
    let last = fs::read_to_string(output)?.lines().filter_map(Trial::parse).next_back();
    Ok(match (last, status) {
        (Some(trial), _) if trial.error <= tolerance => Verdict::Kept(trial),
        (last, None) => Verdict::Missed(format!("over {limit} s; {}", reached(last))),
        (last, Some(status)) if status.success() => Verdict::Missed(reached(last)),
        (_, Some(status)) => Verdict::Missed(format!("ended with {status}")),
    })
}

fn reached(last: Option<Trial>) -> String {
    last.map_or("no trial finished".into(), |trial| format!("reached {:.1e}", trial.error))
}

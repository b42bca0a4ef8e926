//! Ctrl-C at any moment.

use std::process::{Command, Stdio};
use std::thread::sleep;
use std::time::Duration;

use super::{BINARY, Folder};

#[test]
#[cfg(unix)]
fn ctrl_c_ends_a_sum_at_any_moment_and_leaves_no_half_file() {
    let folder = Folder::new(20_000);
    let before = folder.names();
    let start = |repeat: &str| {
        let flags =
            "--points points.npy --charges charges.npy --out values.csv --report report.json";
        Command::new(BINARY)
            .arg("sum")
            .current_dir(folder.path("."))
            .args(flags.split_whitespace())
            .args(["--kernel", "erfc(r)/r + cos(3*r)", "--repeat", repeat])
            .stderr(Stdio::piped())
            .stdout(Stdio::null())
            .spawn()
            .expect("the program runs")
    };
    // From reading to summing: so many sums that none of these comes to its end.
    for moment in [3u32, 6, 12, 25, 50, 100, 200, 400, 800, 1600] {
        let mut child = start("100000");
        sleep(Duration::from_millis(u64::from(moment)));
        let sent = Command::new("kill").args(["-INT", &child.id().to_string()]).status();
        assert!(sent.expect("kill runs").success());
        let status = child.wait().expect("the program ends");
        // Before it listens, the system ends it by the signal itself.
        let early = status.code().is_none() && moment < 400;
        assert!(early || status.code() == Some(130), "{moment}: {status}");
        assert_eq!(folder.names(), before, "{moment}");
    }
    let ended = start("1").wait_with_output().expect("the program ends");
    assert!(ended.status.success(), "{}", String::from_utf8_lossy(&ended.stderr));
    // No bar where nobody looks.
    assert!(ended.stderr.is_empty(), "{}", String::from_utf8_lossy(&ended.stderr));
    assert_eq!(folder.names().len(), before.len() + 2);
}

//! What `benches/peers` has measured: 1/r by other libraries.

use std::fs;
use std::io::ErrorKind;
use std::path::Path;

/// A sum by another library. Times in seconds.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Rival {
    /// Where the points lie.
    pub(crate) cloud: String,
    /// How many.
    pub(crate) n: usize,
    /// Who sums.
    pub(crate) who: String,
    /// Relative l2 error.
    pub(crate) error: f64,
    /// What depends on the points alone; 0 if it can't be had apart.
    pub(crate) plan: f64,
    /// From charges to values.
    pub(crate) apply: f64,
}

/// Reads the file; no rivals if it isn't there.
///
/// # Errors
/// If it can't be read or isn't what `benches/peers` writes.
pub(crate) fn read(file: &Path) -> Result<Vec<Rival>, String> {
    let text = match fs::read_to_string(file) {
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(Vec::new()),
        text => text.map_err(|error| format!("{}: {error}", file.display()))?,
    };
    parse(&text).map_err(|line| format!("{}: not a row of peers: {line}", file.display()))
}

/// The rows of all but farfield itself, or a line that isn't one.
fn parse(text: &str) -> Result<Vec<Rival>, &str> {
    let mut rivals = Vec::new();
    for line in text.lines().skip(1) {
        let fields: Vec<&str> = line.split(',').collect();
        let &[cloud, n, _asked, _threads, who, _knob, error, plan, apply] = fields.as_slice()
        else {
            return Err(line);
        };
        let number = |text: &str| text.parse::<f64>().map_err(|_| line);
        let [error, plan, apply] = [number(error)?, number(plan)?, number(apply)?];
        let n = n.parse().map_err(|_| line)?;
        if who != "farfield" {
            rivals.push(Rival { cloud: cloud.into(), n, who: who.into(), error, plan, apply });
        }
    }
    Ok(rivals)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_of_peers_are_read_and_others_are_named() {
        let header = "cloud,n,asked,threads,who,knob,error,plan,apply\n";
        let rows = "cube,1000,1e-3,2,farfield,1e-3,1e-4,0.1,0.2\n\
                    cube,1000,1e-3,2,ferreus,4e0,2e-4,0.3,0.4\n";
        let rival = Rival {
            cloud: "cube".into(),
            n: 1000,
            who: "ferreus".into(),
            error: 2e-4,
            plan: 0.3,
            apply: 0.4,
        };
        assert_eq!(parse(&format!("{header}{rows}")), Ok(vec![rival]));
        assert_eq!(parse(&format!("{header}cube,few")), Err("cube,few"));
    }
}

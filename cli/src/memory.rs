//! How much memory the process has used.

use std::fs;

/// The largest amount of memory this process has had in use, in bytes: VmHWM of `/proc/self/status`.
/// None on systems that don't have it.
pub(crate) fn peak_memory_bytes() -> Option<u64> {
    let status = fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kibibytes: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(1024 * kibibytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[cfg(target_os = "linux")]
    fn this_process_uses_some_memory() {
        assert!(peak_memory_bytes().expect("VmHWM") > 1 << 20);
    }
}

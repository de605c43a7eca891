//! The most memory that the process has held.

/// Most memory that this process has held so far, by Linux's account; `None` elsewhere.
pub fn peak_memory() -> Option<u64> {
    resident_peak(&std::fs::read_to_string("/proc/self/status").ok()?)
}

fn resident_peak(status: &str) -> Option<u64> {
    let line = status
        .lines()
        .find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kilobytes: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    kilobytes.checked_mul(1024)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_peak_is_read_from_the_status() {
        let status = "Name:\tbake\nVmPeak:\t  9000 kB\nVmHWM:\t    1234 kB\nThreads:\t2\n";
        assert_eq!(resident_peak(status), Some(1234 * 1024));
        for broken in [
            "",
            "VmHWM:\t12 MB",
            "VmHWM:\tkB",
            "VmHWM: 99999999999999999999 kB",
        ] {
            assert_eq!(resident_peak(broken), None);
        }
        if cfg!(target_os = "linux") {
            assert!(peak_memory().is_some_and(|bytes| bytes > 1 << 20));
        }
    }
}

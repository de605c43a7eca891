//! CPU seconds, which other work on the machine does not change as it does wall time.

use std::time::Instant;

/// Ticks a second of Linux's accounts in /proc, on every architecture.
const TICKS: f64 = 100.0;

/// Seconds that this process and its finished children have computed so far; `None` where the system does not say.
pub fn seconds() -> Option<f64> {
    let stat = std::fs::read_to_string("/proc/self/stat").ok()?;
    // The name, in brackets, may hold blanks.
    let fields = &stat[stat.rfind(')')? + 2..];
    let ticks = fields.split(' ').skip(11).take(4);
    let sum: f64 = ticks.filter_map(|field| field.parse::<f64>().ok()).sum();
    Some(sum / TICKS)
}

/// A stopwatch over CPU seconds, or wall seconds where those are unknown.
pub struct Watch {
    cpu: Option<f64>,
    wall: Instant,
}

impl Watch {
    pub fn start() -> Self {
        Self {
            cpu: seconds(),
            wall: Instant::now(),
        }
    }

    pub fn seconds(&self) -> f64 {
        match (self.cpu, seconds()) {
            (Some(from), Some(to)) => to - from,
            _ => self.wall.elapsed().as_secs_f64(),
        }
    }
}

/// Seconds of one call, from as many as `least` seconds hold.
pub fn of_one(least: f64, mut call: impl FnMut()) -> f64 {
    let watch = Watch::start();
    let mut calls = 0_u32;
    loop {
        call();
        calls += 1;
        let seconds = watch.seconds();
        if seconds >= least {
            return seconds / f64::from(calls);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn work_is_counted() {
        let mut sum = 0.0_f64;
        let seconds = of_one(0.05, || {
            for value in 0..200_000 {
                sum += f64::from(value).sqrt();
            }
        });
        assert!(sum > 0.0 && seconds > 0.0 && seconds < 1.0, "{seconds}");
    }
}

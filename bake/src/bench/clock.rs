//! CPU seconds of this process and of the programs it ran, by Linux's account.

use std::fs;
use std::time::Instant;

/// Clock ticks a second in `/proc/PID/stat`: `USER_HZ`, which is 100 on every architecture.
const TICKS: f64 = 100.0;

/// Times a piece of work.
pub struct Clock {
    wall: Instant,
    cpu: Option<f64>,
}

/// What a piece of work took.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Spent {
    pub wall_seconds: f64,
    /// Of all threads; wall seconds where the system does not tell.
    pub cpu_seconds: f64,
}

impl Clock {
    pub fn start() -> Self {
        Self {
            wall: Instant::now(),
            cpu: own_seconds().zip(children_seconds()).map(|(a, b)| a + b),
        }
    }

    pub fn stop(&self) -> Spent {
        let wall_seconds = self.wall.elapsed().as_secs_f64();
        let now = own_seconds().zip(children_seconds()).map(|(a, b)| a + b);
        let cpu = now.zip(self.cpu).map(|(now, then)| now - then);
        Spent {
            wall_seconds,
            cpu_seconds: cpu.unwrap_or(wall_seconds),
        }
    }
}

/// CPU seconds of one call, from as many calls as `least` seconds hold.
pub fn of_one(least: f64, mut call: impl FnMut()) -> f64 {
    let clock = Clock::start();
    let mut calls = 0_u32;
    loop {
        call();
        calls += 1;
        let seconds = clock.stop().cpu_seconds;
        if seconds >= least {
            return seconds / f64::from(calls);
        }
    }
}

/// Sum over the threads, to the nanosecond.
fn own_seconds() -> Option<f64> {
    let mut nanoseconds = 0.0;
    for task in fs::read_dir("/proc/self/task").ok()? {
        let path = task.ok()?.path().join("schedstat");
        let text = fs::read_to_string(path).ok()?;
        nanoseconds += text.split_whitespace().next()?.parse::<f64>().ok()?;
    }
    Some(nanoseconds * 1e-9)
}

/// User time of the programs that ended.
fn children_seconds() -> Option<f64> {
    children_ticks(&fs::read_to_string("/proc/self/stat").ok()?).map(|ticks| ticks / TICKS)
}

fn children_ticks(stat: &str) -> Option<f64> {
    // The name in parentheses may hold blanks; `cutime` is the sixteenth field.
    let rest = stat.rsplit_once(')')?.1;
    rest.split_whitespace().nth(13)?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_of_children_are_found_behind_any_name() {
        let stat = "12 (a b) c) S 1 2 3 4 5 6 7 8 9 10 11 12 456 13 0 0";
        assert_eq!(children_ticks(stat), Some(456.0));
        assert_eq!(children_ticks("12 (a) S 1"), None);
    }

    #[test]
    fn work_takes_time() {
        let clock = Clock::start();
        let mut sum = 0.0_f64;
        while clock.wall.elapsed().as_millis() < 20 {
            sum += sum.sin() + 1.0;
        }
        let spent = clock.stop();
        assert!(spent.wall_seconds >= 0.02 && spent.cpu_seconds > 0.0 && sum > 0.0);
    }
}

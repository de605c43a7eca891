//! Times of the steps of the preparation.

use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};

use crate::label::Label;

/// A step, in the order of work.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Step {
    /// Areas of the triangles, and flat normals where the source has none.
    Normals,
    Tangents,
    Weld,
    VertexCache,
    Overdraw,
    VertexFetch,
    /// Local bounds, and the world bounds of the instances.
    Bounds,
    /// Emissive triangles.
    Emission,
    /// Nothing but measuring.
    Analysis,
}

const NAMES: [&str; 9] = [
    "normals",
    "tangents",
    "weld",
    "vertex cache",
    "overdraw",
    "vertex fetch",
    "bounds",
    "emission",
    "analysis",
];

/// Time of one step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct StepTime {
    #[serde(deserialize_with = "crate::label::read")]
    pub name: Label,
    /// Summed over threads.
    pub seconds: f64,
    /// Triangles that needed the step.
    pub triangles: u64,
}

impl StepTime {
    /// Millions of triangles in a second of one thread; `None` where nothing was timed.
    pub fn mega_triangles_per_second(&self) -> Option<f64> {
        (self.seconds > 0.0).then(|| self.triangles as f64 / self.seconds / 1e6)
    }
}

/// Times of all steps; they are no part of a package.
#[derive(rkyv::Archive, rkyv::Serialize, rkyv::Deserialize, Clone, Copy, Debug, Default)]
pub(super) struct Steps([(f64, u64); NAMES.len()]);

impl Steps {
    /// Runs a step over `triangles`.
    pub(super) fn time<T>(&mut self, step: Step, triangles: u64, work: impl FnOnce() -> T) -> T {
        let start = Instant::now();
        let result = work();
        self.record(step, triangles, start.elapsed());
        result
    }

    /// Adds a step over `triangles` that took `time`.
    pub(super) fn record(&mut self, step: Step, triangles: u64, time: Duration) {
        let (seconds, count) = &mut self.0[step as usize];
        *seconds += time.as_secs_f64();
        *count += triangles;
    }

    /// Adds the times of another part of the scene.
    pub(super) fn add(&mut self, other: &Self) {
        for (sum, (seconds, triangles)) in self.0.iter_mut().zip(other.0) {
            sum.0 += seconds;
            sum.1 += triangles;
        }
    }

    /// The steps that were run, in order.
    pub(super) fn list(&self) -> Vec<StepTime> {
        let steps = NAMES.into_iter().zip(self.0);
        steps
            .filter(|(_, (_, triangles))| *triangles > 0)
            .map(|(name, (seconds, triangles))| StepTime {
                name,
                seconds,
                triangles,
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_steps_that_ran_are_listed() {
        let mut steps = Steps::default();
        assert_eq!(steps.time(Step::Overdraw, 7, || 3), 3);
        let mut sum = steps;
        sum.add(&steps);
        sum.time(Step::Analysis, 1, || ());
        let list = sum.list();
        let names: Vec<&str> = list.iter().map(|step| step.name).collect();
        assert_eq!(names, ["overdraw", "analysis"]);
        assert_eq!(list[0].triangles, 14);
        let known = StepTime {
            name: "weld",
            seconds: 0.5,
            triangles: 1_000_000,
        };
        assert_eq!(known.mega_triangles_per_second(), Some(2.0));
    }
}

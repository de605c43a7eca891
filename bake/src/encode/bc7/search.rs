//! The search over ways of storing blocks: mode 6 first, then those of least estimated error.

use pulp::Simd;

use super::estimate::{Estimate, Ranked};
use super::fit::Effort;
use super::jobs::{Alpha, Job, Queue, Way};
use super::preset::Preset;
use super::stages::{Batch, FitJobs, PackJobs, PolishJobs};
use super::texels::{MOST_LANES, Packed};

/// Blocks that are searched together.
pub(super) struct Search<'a, S: Simd> {
    pub simd: S,
    pub blocks: &'a [Packed],
    pub alpha: Alpha,
    pub preset: &'a Preset,
}

impl<S: Simd> Search<'_, S> {
    /// The ways kept of each block, best first, as many as the preset keeps; those left over have an infinite error.
    #[inline(always)]
    pub fn find(&self) -> Vec<Job> {
        let kept = self.preset.kept;
        let mut found: Vec<Job> = (0..self.blocks.len() as u32)
            .flat_map(|slot| std::iter::repeat_n(Job::new(slot, Way::WHOLE), kept))
            .collect();
        let mut queue = Queue::default();
        for slot in 0..self.blocks.len() as u32 {
            queue.push(Job::new(slot, Way::WHOLE));
        }
        self.fit(&mut queue, self.preset.whole, &mut found);
        let mut queue = self.promising(&found);
        self.fit(&mut queue, self.preset.parts, &mut found);
        found
    }

    /// Fits jobs, and keeps those that are among the best of their block.
    #[inline(always)]
    fn fit(&self, queue: &mut Queue, effort: Effort, found: &mut [Job]) {
        let kept = self.preset.kept;
        for jobs in queue.kinds() {
            for jobs in jobs.chunks_mut(S::F32_LANES) {
                // Lanes without a job repeat the first.
                let worst = |job: &Job| found[(job.slot as usize + 1) * kept - 1].error;
                let mut limits = [worst(&jobs[0]); MOST_LANES];
                for (limit, job) in limits.iter_mut().zip(&*jobs) {
                    *limit = worst(job);
                }
                self.simd.vectorize(FitJobs {
                    batch: self.batch(jobs),
                    effort,
                    limits,
                });
                for job in jobs {
                    let at = job.slot as usize * kept;
                    keep(&mut found[at..at + kept], job);
                }
            }
        }
    }

    #[inline(always)]
    fn batch<'b>(&'b self, jobs: &'b mut [Job]) -> Batch<'b> {
        Batch {
            blocks: self.blocks,
            alpha: self.alpha,
            jobs,
        }
    }

    /// Ways that may be better than mode 6.
    #[inline(always)]
    fn promising(&self, found: &[Job]) -> Queue {
        let mut queue = Queue::default();
        let preset = self.preset;
        if preset.tried == 0 {
            return queue;
        }
        let wholes = found.iter().step_by(preset.kept);
        let rest: Vec<&Job> = wholes.filter(|job| job.error > preset.enough).collect();
        let opaque = self.alpha != Alpha::Varies;
        let promise = preset.promise[usize::from(opaque)];
        let mut ranked = Ranked::new();
        for jobs in rest.chunks(S::F32_LANES) {
            let mut slots = [jobs[0].slot; MOST_LANES];
            for (slot, job) in slots.iter_mut().zip(jobs) {
                *slot = job.slot;
            }
            self.simd.vectorize(Estimate {
                blocks: self.blocks,
                slots,
                opaque,
                preset,
                ranked: &mut ranked,
            });
            for (lane, job) in jobs.iter().enumerate() {
                let most = job.error * promise;
                for way in ranked.best(lane, most, preset.tried) {
                    queue.push(Job::new(job.slot, way));
                }
            }
        }
        queue
    }

    /// Improves the ways kept; the best of each block comes first.
    #[inline(always)]
    pub fn polish(&self, found: &mut [Job]) {
        let kept = self.preset.kept;
        let mut queue = Queue::default();
        for job in &*found {
            if job.error.is_finite() {
                queue.push(*job);
            }
        }
        for job in &mut *found {
            job.error = f32::INFINITY;
        }
        for jobs in queue.kinds() {
            for jobs in jobs.chunks_mut(S::F32_LANES) {
                self.simd.vectorize(PolishJobs {
                    batch: self.batch(jobs),
                    preset: self.preset,
                });
                for job in jobs {
                    let at = job.slot as usize * kept;
                    keep(&mut found[at..at + kept], job);
                }
            }
        }
    }

    /// The blocks of the best ways, and their slots.
    #[inline(always)]
    pub fn pack(&self, found: &[Job], mut write: impl FnMut(u32, [u8; 16])) {
        let mut queue = Queue::default();
        for job in found.iter().step_by(self.preset.kept) {
            queue.push(*job);
        }
        let mut out = [[0; 16]; MOST_LANES];
        for jobs in queue.kinds() {
            for jobs in jobs.chunks_mut(S::F32_LANES) {
                self.simd.vectorize(PackJobs {
                    batch: self.batch(jobs),
                    out: &mut out,
                });
                for (job, block) in jobs.iter().zip(&out) {
                    write(job.slot, *block);
                }
            }
        }
    }
}

/// Puts a job among the best of its block; earlier ones stay before later ones of the same error.
#[inline(always)]
fn keep(best: &mut [Job], job: &Job) {
    let mut at = best.len();
    while at > 0 && job.error < best[at - 1].error {
        at -= 1;
    }
    if at < best.len() {
        best[at..].rotate_right(1);
        best[at] = *job;
    }
}

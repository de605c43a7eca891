//! Work on many large things with only a few of them in memory.

use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Results of `work` on `0..count`, in order. As many are at work at once as there are threads, however deep `work`
/// itself goes parallel: a thread that waits for others may only begin what none has begun, and there is one loop a
/// thread. What an unbounded parallel map holds while it waits grows with `count`.
pub fn map<T: Send>(count: usize, work: impl Fn(usize) -> T + Sync) -> Vec<T> {
    let next = AtomicUsize::new(0);
    let done = Mutex::new(Vec::with_capacity(count));
    rayon::scope(|scope| {
        for _ in 0..rayon::current_num_threads().min(count) {
            scope.spawn(|_| {
                loop {
                    let index = next.fetch_add(1, Ordering::Relaxed);
                    if index >= count {
                        return;
                    }
                    let result = work(index);
                    let mut done = done.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
                    done.push((index, result));
                }
            });
        }
    });
    let mut done = done
        .into_inner()
        .unwrap_or_else(|poisoned| poisoned.into_inner());
    done.sort_by_key(|(index, _)| *index);
    done.into_iter().map(|(_, result)| result).collect()
}

#[cfg(test)]
mod tests {
    use rayon::prelude::*;

    use super::*;

    #[test]
    fn order_is_kept_and_no_more_than_the_threads_are_at_work() {
        for threads in [1, 3] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
            let (now, most) = (AtomicUsize::new(0), AtomicUsize::new(0));
            let squares = pool.expect("a pool").install(|| {
                map(40, |index| {
                    most.fetch_max(now.fetch_add(1, Ordering::SeqCst) + 1, Ordering::SeqCst);
                    let sum: usize = (0..2000).into_par_iter().map(|_| index).sum();
                    now.fetch_sub(1, Ordering::SeqCst);
                    sum / 2000 * index
                })
            });
            assert_eq!(
                squares,
                (0..40).map(|index| index * index).collect::<Vec<_>>()
            );
            assert!(
                most.load(Ordering::SeqCst) <= threads,
                "{most:?} at {threads}"
            );
        }
        assert!(map(0, |index| index).is_empty());
    }
}

//! Thread pool shared by the stages of one image.
//!
//! Work is divided by position into fixed parts, each executed exactly once, and results are combined in the order of
//! the parts. So the number of threads affects only the time. Work outside [`Workers::run`] uses a single thread.

use rayon_core::{ThreadPool, ThreadPoolBuilder};
use std::sync::Arc;

/// A thread pool, empty by default. Clones share it.
#[derive(Clone, Debug, Default)]
pub struct Workers(Option<Arc<ThreadPool>>);

impl Workers {
    /// Starts this many threads, named `worker`, with the priority of the calling thread. With fewer than two, work
    /// runs on the calling thread.
    ///
    /// # Errors
    /// The operating system's error if threads cannot be started.
    pub fn new(threads: usize) -> std::io::Result<Self> {
        if threads < 2 {
            return Ok(Self::default());
        }
        let pool = ThreadPoolBuilder::new()
            .num_threads(threads)
            .thread_name(|_| "worker".to_owned())
            .build()
            .map_err(std::io::Error::other)?;
        Ok(Self(Some(Arc::new(pool))))
    }

    /// Runs work on the pool and waits for it; [`both`], [`fill`] and [`in_rows`] inside are shared among its threads.
    pub fn run<R: Send>(&self, work: impl FnOnce() -> R + Send) -> R {
        match &self.0 {
            Some(pool) => pool.install(work),
            None => work(),
        }
    }
}

/// Whether the current thread belongs to [`Workers`], i.e. works for a thread that waits in [`Workers::run`].
#[must_use]
pub fn is_one() -> bool {
    rayon_core::current_thread_index().is_some()
}

/// Runs two pieces of work, in parallel inside [`Workers`].
pub fn both<A: Send, B: Send>(
    a: impl FnOnce() -> A + Send,
    b: impl FnOnce() -> B + Send,
) -> (A, B) {
    if is_one() {
        rayon_core::join(a, b)
    } else {
        (a(), b())
    }
}

/// Computes values by calling `work` with each index.
pub fn fill<T: Send>(values: &mut [T], work: impl Fn(usize) -> T + Sync) {
    in_rows(values, 1, |first, values| {
        for (i, value) in values.iter_mut().enumerate() {
            *value = work(first + i);
        }
    });
}

/// Calls `work` on parts of rows of `width` values, with the index of the first row. Outside [`Workers`] all rows are
/// one part: results must not depend on the division.
pub fn in_rows<T: Send>(values: &mut [T], width: usize, work: impl Fn(usize, &mut [T]) + Sync) {
    fn divide<T: Send>(
        (first, parts): (usize, usize),
        (values, width): (&mut [T], usize),
        work: &(impl Fn(usize, &mut [T]) + Sync),
    ) {
        if parts < 2 {
            return work(first, values);
        }
        let (half, rows) = (parts / 2, values.len() / width);
        let middle = rows * half / parts;
        let (a, b) = values.split_at_mut(middle * width);
        rayon_core::join(
            || divide((first, half), (a, width), work),
            || divide((first + middle, parts - half), (b, width), work),
        );
    }
    let width = width.max(1);
    let parts = if is_one() {
        (values.len() / width.max(LEAST)).clamp(1, PARTS)
    } else {
        1
    };
    divide((0, parts), (values, width), &work);
}

/// Minimum number of values per part. Measured: the flow of 1000 points takes 0.71 ms (decision 38), so that of 60 some
/// 50 us, and less is not worth a thread.
const LEAST: usize = 60;
/// Maximum parts per piece of work: more than threads, since durations and start times vary.
const PARTS: usize = 4;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_parts_run_once_in_order_with_any_worker_count() {
        for workers in [Workers::default(), Workers::new(3).unwrap()] {
            for count in [0, 1, 2, 7, 1000] {
                let (mut values, mut rows) = (vec![0; count], vec![0; 3 * count]);
                workers.run(|| fill(&mut values, |i| i + 5));
                assert_eq!(values, (5..5 + count).collect::<Vec<_>>());
                workers.run(|| {
                    in_rows(&mut rows, 3, |first, rows| {
                        rows.iter_mut()
                            .enumerate()
                            .for_each(|(i, r)| *r += 3 * first + i);
                    });
                });
                assert_eq!(rows, (0..3 * count).collect::<Vec<_>>());
            }
            assert_eq!(workers.run(|| both(|| 1, || "b")), (1, "b"));
        }
    }

    #[test]
    fn panic_propagates_to_the_caller() {
        let workers = Workers::new(2).unwrap();
        let fails = || workers.run(|| both(|| (), || panic!("expected")));
        assert!(std::panic::catch_unwind(std::panic::AssertUnwindSafe(fails)).is_err());
        assert_eq!(workers.run(|| 3), 3);
    }

    #[test]
    fn single_worker_needs_no_pool() {
        assert!(Workers::new(1).unwrap().0.is_none());
    }
}

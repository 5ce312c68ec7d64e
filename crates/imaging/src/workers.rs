//! Threads that share the work on one image.
//!
//! Answers: who else lends a hand. Work is divided by places, never by time: every part is done exactly once, by whoever comes to it, and
//! results are put together in the order of the parts. So how many threads there are, and whether there are any, changes the time and nothing
//! else. What runs outside [`Workers::run`] runs alone.

use rayon_core::{ThreadPool, ThreadPoolBuilder};
use std::ops::Range;
use std::sync::Arc;

/// Threads that wait for work; none by default. Copies share them.
#[derive(Clone, Debug, Default)]
pub struct Workers(Option<Arc<ThreadPool>>);

impl Workers {
    /// So many threads, named `worker`; with fewer than two, whoever has work does it alone. They have the priority of the thread that makes them.
    ///
    /// # Errors
    /// What the operating system says when it has no more threads.
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

    /// Does a piece of work on these threads, so that [`both`], [`for_each`] and [`in_parts`] within it are shared among them; waits for it.
    pub fn run<R: Send>(&self, work: impl FnOnce() -> R + Send) -> R {
        match &self.0 {
            Some(pool) => pool.install(work),
            None => work(),
        }
    }
}

/// Whether this thread is one of [`Workers`]: what it does, it does for whoever waits in [`Workers::run`].
#[must_use]
pub fn is_one() -> bool {
    rayon_core::current_thread_index().is_some()
}

/// Does two pieces of work, one beside the other where there are [`Workers`].
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

/// Does something with each of some things, which are best told in the order of their cost, dearest first; `work` is given its number, too.
pub fn for_each<T: Send>(things: &mut [T], work: impl Fn(usize, &mut T) + Sync) {
    fn halve<T: Send>(first: usize, things: &mut [T], work: &(impl Fn(usize, &mut T) + Sync)) {
        if let [thing] = things {
            work(first, thing);
        } else if !things.is_empty() {
            let middle = things.len() / 2;
            let (a, b) = things.split_at_mut(middle);
            rayon_core::join(|| halve(first, a, work), || halve(first + middle, b, work));
        }
    }
    if is_one() {
        halve(0, things, &work);
    } else {
        things.iter_mut().enumerate().for_each(|(i, t)| work(i, t));
    }
}

/// Does a piece of work for each part of a range, of at least `least` (at least 1) each, and gives the results in order. Where nobody lends a hand
/// the range is one part: `work` must do the same for a whole as for its parts.
pub fn in_parts<R: Send>(
    range: Range<usize>,
    least: usize,
    work: impl Fn(Range<usize>) -> R + Sync,
) -> Vec<R> {
    let parts = if is_one() {
        (range.len() / least.max(1)).clamp(1, PARTS)
    } else {
        1
    };
    let bound = |i: usize| range.start + range.len() * i / parts;
    let mut results: Vec<Option<R>> = (0..parts).map(|_| None).collect();
    for_each(&mut results, |i, result| {
        *result = Some(work(bound(i)..bound(i + 1)));
    });
    results.into_iter().flatten().collect()
}

/// Parts of a range, at most: more than there are threads, since some take longer, and some threads are late.
const PARTS: usize = 4;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn everything_is_done_once_and_in_order_with_and_without_help() {
        for workers in [Workers::default(), Workers::new(3).unwrap()] {
            for count in [0, 1, 2, 7, 1000] {
                let (parts, mut things) = (
                    workers.run(|| in_parts(5..5 + count, 2, |r| r.collect::<Vec<_>>())),
                    vec![0; count],
                );
                assert_eq!(parts.concat(), (5..5 + count).collect::<Vec<_>>());
                workers.run(|| for_each(&mut things, |i, t| *t += i + 1));
                assert_eq!(things, (1..=count).collect::<Vec<_>>());
            }
            assert_eq!(workers.run(|| both(|| 1, || "b")), (1, "b"));
        }
    }

    #[test]
    fn a_panic_reaches_whoever_asked() {
        let workers = Workers::new(2).unwrap();
        let fails = || workers.run(|| both(|| (), || panic!("expected")));
        assert!(std::panic::catch_unwind(std::panic::AssertUnwindSafe(fails)).is_err());
        assert_eq!(workers.run(|| 3), 3);
    }

    #[test]
    fn fewer_than_two_are_none() {
        assert!(Workers::new(1).unwrap().0.is_none());
    }
}

//! The inbox of a stage or a subscriber, and the only lock of the libraries.
//!
//! One mailbox holds everything that a stage may receive, because tracking and mapping wait for several things at once, which the standard
//! library's channels cannot do. The contents decide which messages are kept or replaced.

use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

pub(crate) struct Mailbox<T> {
    state: Mutex<State<T>>,
    changed: Condvar,
}

struct State<T> {
    content: T,
    closed: bool,
}

impl<T: Default> Default for Mailbox<T> {
    fn default() -> Self {
        Self::new(T::default())
    }
}

impl<T> Mailbox<T> {
    pub(crate) fn new(content: T) -> Self {
        Self {
            state: Mutex::new(State {
                content,
                closed: false,
            }),
            changed: Condvar::new(),
        }
    }

    /// Changes the contents, even of a closed mailbox.
    pub(crate) fn change<R>(&self, change: impl FnOnce(&mut T) -> R) -> R {
        let mut state = self.lock();
        let result = change(&mut state.content);
        // A sender may be waiting for room.
        self.changed.notify_all();
        result
    }

    pub(crate) fn is_closed(&self) -> bool {
        self.lock().closed
    }

    /// Changes the contents; `None` if the mailbox is closed.
    pub(crate) fn put<R>(&self, change: impl FnOnce(&mut T) -> R) -> Option<R> {
        self.put_when(|_| true, change)
    }

    /// Changes the contents as soon as there is room; `None` if the mailbox is closed by then.
    pub(crate) fn put_when<R>(
        &self,
        room: impl Fn(&T) -> bool,
        change: impl FnOnce(&mut T) -> R,
    ) -> Option<R> {
        let mut state = self.lock();
        while !state.closed && !room(&state.content) {
            state = self.wait(state);
        }
        if state.closed {
            return None;
        }
        let result = change(&mut state.content);
        self.changed.notify_all();
        Some(result)
    }

    /// Waits until `pick` returns a value; `None` if the mailbox is closed and `pick` finds nothing.
    pub(crate) fn take<R>(&self, mut pick: impl FnMut(&mut T) -> Option<R>) -> Option<R> {
        let mut state = self.lock();
        loop {
            if let Some(picked) = pick(&mut state.content) {
                // A sender may be waiting for room.
                self.changed.notify_all();
                return Some(picked);
            }
            if state.closed {
                return None;
            }
            state = self.wait(state);
        }
    }

    /// Like [`Mailbox::take`], with a time limit.
    pub(crate) fn take_within<R>(
        &self,
        time: Duration,
        mut pick: impl FnMut(&mut T) -> Option<R>,
    ) -> Option<R> {
        let deadline = Instant::now() + time;
        let mut state = self.lock();
        loop {
            if let Some(picked) = pick(&mut state.content) {
                self.changed.notify_all();
                return Some(picked);
            }
            let left = deadline.saturating_duration_since(Instant::now());
            if state.closed || left.is_zero() {
                return None;
            }
            let waited = self.changed.wait_timeout(state, left);
            state = waited.unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    pub(crate) fn look<R>(&self, read: impl FnOnce(&T) -> R) -> R {
        read(&self.lock().content)
    }

    /// Refuses further contents; existing ones can still be taken.
    pub(crate) fn close(&self) {
        self.lock().closed = true;
        self.changed.notify_all();
    }

    /// Ignores poisoning: code under the lock only moves values and cannot panic half-way.
    fn lock(&self) -> MutexGuard<'_, State<T>> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn wait<'a>(&self, state: MutexGuard<'a, State<T>>) -> MutexGuard<'a, State<T>> {
        self.changed
            .wait(state)
            .unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::VecDeque;
    use std::sync::Arc;

    type Queue = Mailbox<VecDeque<u32>>;

    #[test]
    fn closed_mailbox_can_be_emptied_but_not_filled() {
        let mailbox = Queue::default();
        assert_eq!(mailbox.put(|q| q.push_back(1)), Some(()));
        mailbox.close();
        assert_eq!(mailbox.put(|q| q.push_back(2)), None);
        assert_eq!(mailbox.take(VecDeque::pop_front), Some(1));
        assert_eq!(mailbox.take(VecDeque::pop_front), None);
    }

    #[test]
    fn mailbox_is_ordered_and_bounded() {
        let mailbox = Arc::new(Queue::default());
        let sender = std::thread::spawn({
            let mailbox = Arc::clone(&mailbox);
            move || {
                for i in 0..1000 {
                    mailbox.put_when(|q| q.len() < 3, |q| q.push_back(i));
                }
                mailbox.close();
            }
        });
        let mut taken = Vec::new();
        while let Some(i) = mailbox.take(|q| {
            assert!(q.len() <= 3);
            q.pop_front()
        }) {
            taken.push(i);
        }
        sender.join().unwrap();
        assert_eq!(taken, (0..1000).collect::<Vec<_>>());
    }

    #[test]
    fn closing_wakes_waiting_senders() {
        let mailbox = Arc::new(Queue::default());
        let waiting = std::thread::spawn({
            let mailbox = Arc::clone(&mailbox);
            move || mailbox.put_when(|_| false, |q| q.push_back(1))
        });
        std::thread::sleep(std::time::Duration::from_millis(10));
        mailbox.close();
        assert_eq!(waiting.join().unwrap(), None);
    }
}

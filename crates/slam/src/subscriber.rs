//! Subscribers to the events of a run.
//!
//! Inline and in a replay every subscriber receives every event, in order, on the thread that drives the run. In a live
//! run the driver gives each a queue and a thread of its own.

use crate::event::Event;

/// Receives events of a run, without influence on it.
pub trait Subscriber {
    /// Receives an event, in the order documented at [`Event`].
    fn receive(&mut self, event: &Event);

    /// Receives several events in order.
    fn receive_all<'a>(&mut self, events: impl IntoIterator<Item = &'a Event>)
    where
        Self: Sized,
    {
        events.into_iter().for_each(|event| self.receive(event));
    }
}

impl<S: Subscriber + ?Sized> Subscriber for &mut S {
    fn receive(&mut self, event: &Event) {
        (**self).receive(event);
    }
}

impl<S: Subscriber + ?Sized> Subscriber for Box<S> {
    fn receive(&mut self, event: &Event) {
        (**self).receive(event);
    }
}

/// `None` ignores all events.
impl<S: Subscriber> Subscriber for Option<S> {
    fn receive(&mut self, event: &Event) {
        if let Some(subscriber) = self {
            subscriber.receive(event);
        }
    }
}

/// Several subscribers; each event goes to all of them before the next.
impl<S: Subscriber> Subscriber for Vec<S> {
    fn receive(&mut self, event: &Event) {
        self.iter_mut().for_each(|s| s.receive(event));
    }
}

/// Two subscribers of different types, in order.
impl<A: Subscriber, B: Subscriber> Subscriber for (A, B) {
    fn receive(&mut self, event: &Event) {
        self.0.receive(event);
        self.1.receive(event);
    }
}

/// A closure as subscriber.
#[derive(Clone, Copy, Debug)]
pub struct OnEvent<F>(pub F);

impl<F: FnMut(&Event)> Subscriber for OnEvent<F> {
    fn receive(&mut self, event: &Event) {
        (self.0)(event);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gate::{RefusalReason, RefusedFrame};
    use std::cell::RefCell;
    use stillpoint_imaging::FrameId;

    #[test]
    fn every_subscriber_receives_every_event_in_order() {
        let received = RefCell::new(Vec::new());
        let received = &received;
        let note = |name: &'static str| {
            OnEvent(move |event: &Event| {
                if let Event::Refused(r) = event {
                    received.borrow_mut().push((name, r.frame.0));
                }
            })
        };
        let (mut first, mut second) = (note("first"), note("second"));
        let listed: Vec<&mut dyn Subscriber> = vec![&mut first, &mut second];
        let boxed: Option<Box<dyn Subscriber>> = Some(Box::new(note("third")));
        let mut all = (listed, boxed);
        let refused = |n: u32| {
            Event::Refused(RefusedFrame {
                frame: FrameId(n),
                stamp: 0.0,
                reason: RefusalReason::NoStamp,
            })
        };
        all.receive_all(&[refused(1), refused(2)]);
        None::<OnEvent<fn(&Event)>>.receive(&refused(3));
        drop(all);
        let names = ["first", "second", "third"];
        let expected = [1, 2].iter().flat_map(|n| names.map(|name| (name, *n)));
        assert_eq!(*received.borrow(), expected.collect::<Vec<_>>());
    }
}

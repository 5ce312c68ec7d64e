//! Delivers the events of a live run to subscribers: a queue for each, and a thread on request.
//!
//! No stage ever waits for a subscriber. A stage puts an event into every queue and continues; events that do not fit are dropped by the
//! subscriber's rule, and counted.

mod listening;

pub use listening::Subscribed;
pub(crate) use listening::{Listening, start};

use crate::mailbox::Mailbox;
use std::collections::VecDeque;
use std::mem::discriminant;
use std::sync::Arc;
use std::time::Duration;
use stillpoint_slam::{Event, FrameEvent};

/// The events that a subscriber receives, and the rule for dropping when it falls behind.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Delivery {
    rule: Rule,
    /// Maximum number of queued events; with [`Rule::Newest`] of each kind.
    events: usize,
    images: usize,
    /// Images are delivered with every n-th frame.
    every: usize,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Rule {
    UntilFull,
    Newest,
}

impl Delivery {
    /// Every event in order, unless `events` of them (at least 1) are queued; further ones are dropped. Without images. For subscribers
    /// that count or write. At 30 Hz, 4096 events are about a minute.
    #[must_use]
    pub fn until_full(events: usize) -> Self {
        Self {
            rule: Rule::UntilFull,
            events: events.max(1),
            images: 0,
            every: 1,
        }
    }

    /// The newest `events` of each kind (at least 1); older ones are dropped. Without images. For subscribers that display the current
    /// state.
    #[must_use]
    pub fn newest(events: usize) -> Self {
        Self {
            rule: Rule::Newest,
            ..Self::until_full(events)
        }
    }

    /// With the image of every `every`-th tracked frame, from the first on; at most `images` are queued. Beyond that, with
    /// [`Delivery::until_full`] a frame comes without its image; with [`Delivery::newest`] older frames are dropped. An image of 640x480
    /// with depth and colour takes 2.4 MB.
    #[must_use]
    pub fn with_images(mut self, images: usize, every: usize) -> Self {
        (self.images, self.every) = (images, every.max(1));
        self
    }
}

struct Waiting {
    delivery: Delivery,
    events: VecDeque<Event>,
    /// Number of queued frames with their image.
    images: usize,
    frames: usize,
    missed: Missed,
    taken: u64,
}

/// Events and images that a subscriber missed because it was too slow.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Missed {
    /// Number of dropped events.
    pub events: u64,
    /// Number of frames delivered without their image.
    pub images: u64,
}

/// An event offered to several queues; a copy without the image is made on demand.
struct Offer<'a> {
    event: &'a Event,
    bare: Option<Event>,
}

impl Offer<'_> {
    fn bare(&mut self) -> Event {
        let event = self.event;
        let bare = self.bare.get_or_insert_with(|| match event {
            Event::Frame(frame) => Event::Frame(Arc::new(FrameEvent {
                frame: None,
                report: frame.report.clone(),
                health: frame.health.clone(),
            })),
            other => other.clone(),
        });
        bare.clone()
    }
}

fn has_image(event: &Event) -> bool {
    event.as_frame().is_some_and(|f| f.frame.is_some())
}

impl Waiting {
    fn new(delivery: Delivery) -> Self {
        Self {
            delivery,
            events: VecDeque::new(),
            images: 0,
            frames: 0,
            missed: Missed::default(),
            taken: 0,
        }
    }

    /// Queues an event, or drops one by the rule.
    fn offer(&mut self, offer: &mut Offer<'_>) {
        let wants_image = self.wants_image(offer.event);
        match self.delivery.rule {
            Rule::UntilFull if self.events.len() >= self.delivery.events => {
                self.missed.events += 1;
                return;
            }
            Rule::UntilFull => {}
            Rule::Newest => self.make_room(offer.event, wants_image),
        }
        let fits = wants_image && self.images < self.delivery.images;
        self.missed.images += u64::from(wants_image && !fits);
        self.images += usize::from(fits);
        let event = if fits {
            offer.event.clone()
        } else {
            offer.bare()
        };
        self.events.push_back(event);
    }

    /// Whether this is a frame whose image is wanted.
    fn wants_image(&mut self, event: &Event) -> bool {
        if event.as_frame().is_none() {
            return false;
        }
        let turn = self.frames.is_multiple_of(self.delivery.every);
        self.frames += 1;
        turn && self.delivery.images > 0 && has_image(event)
    }

    /// Drops the oldest events of the same kind until one more fits.
    fn make_room(&mut self, event: &Event, wants_image: bool) {
        let kind = discriminant(event);
        loop {
            let alike = self.events.iter().filter(|e| discriminant(*e) == kind);
            let is_full = alike.count() >= self.delivery.events
                || (wants_image && self.images >= self.delivery.images);
            let oldest = self.events.iter().position(|e| discriminant(e) == kind);
            let (true, Some(oldest)) = (is_full, oldest) else {
                return;
            };
            let left_out = self.events.remove(oldest);
            self.images -= usize::from(left_out.as_ref().is_some_and(has_image));
            self.missed.events += 1;
        }
    }

    fn next(&mut self) -> Option<Event> {
        let event = self.events.pop_front()?;
        self.images -= usize::from(has_image(&event));
        self.taken += 1;
        Some(event)
    }

    fn give_up(&mut self) {
        self.missed.events += self.events.len() as u64;
        self.events.clear();
        self.images = 0;
    }

    /// Whether the events of some more frames fit, with their images. Three frames: one is being tracked, one is queued, one is coming;
    /// each may cause eight events.
    fn has_room(&self) -> bool {
        const FRAMES: usize = 3;
        let fits =
            |waiting: usize, coming: usize, most: usize| waiting == 0 || waiting + coming <= most;
        self.delivery.rule == Rule::Newest
            || (fits(self.events.len(), 8 * FRAMES, self.delivery.events)
                && fits(self.images, FRAMES, self.delivery.images))
    }
}

type Queue = Arc<Mailbox<Waiting>>;

#[derive(Default)]
pub(crate) struct Audience(Mailbox<Vec<(String, Queue)>>);

impl Audience {
    /// Publishes an event without waiting.
    pub(crate) fn publish(&self, event: &Event) {
        let mut offer = Offer { event, bare: None };
        self.0.look(|queues| {
            for (_, queue) in queues {
                queue.put(|q| q.offer(&mut offer));
            }
        });
    }

    /// Adds a subscriber for events from now on.
    pub(crate) fn listen(&self, name: &str, delivery: Delivery) -> Events {
        let queue = Arc::new(Mailbox::new(Waiting::new(delivery)));
        let kept = Arc::clone(&queue);
        self.0.put(|queues| queues.push((name.to_owned(), kept)));
        Events { queue }
    }

    /// Waits until every complete subscription has room for the events of the next frame.
    pub(crate) fn wait_for_room(&self) {
        let queues: Vec<Queue> = self.0.look(|all| all.iter().map(|q| q.1.clone()).collect());
        for queue in queues {
            queue.put_when(Waiting::has_room, |_| {});
        }
    }

    /// Ends the stream: every subscriber ends after its pending events.
    pub(crate) fn close(&self) {
        self.0
            .look(|queues| queues.iter().for_each(|q| q.1.close()));
    }

    /// Missed events of each subscriber, by name, in the order of subscription.
    pub(crate) fn missed(&self) -> Vec<(String, Missed)> {
        let missed = |(name, queue): &(String, Queue)| (name.clone(), queue.look(|q| q.missed));
        self.0.look(|queues| queues.iter().map(missed).collect())
    }
}

/// Events of a live run, for polling. They end with the run, or when this is dropped.
pub struct Events {
    queue: Queue,
}

impl Events {
    /// Waits for the next event; `None` when the run is over and all were taken.
    pub fn recv(&self) -> Option<Event> {
        self.queue.take(Waiting::next)
    }

    /// The next event within a time.
    pub fn recv_within(&self, time: Duration) -> Option<Event> {
        self.queue.take_within(time, Waiting::next)
    }

    /// The next event if available.
    pub fn try_recv(&self) -> Option<Event> {
        self.queue.change(Waiting::next)
    }

    /// The available events.
    pub fn try_iter(&self) -> impl Iterator<Item = Event> {
        std::iter::from_fn(|| self.try_recv())
    }

    /// All events until the end of the run.
    pub fn iter(&self) -> impl Iterator<Item = Event> {
        std::iter::from_fn(|| self.recv())
    }

    /// Number of events and images missed.
    #[must_use]
    pub fn missed(&self) -> Missed {
        self.queue.look(|q| q.missed)
    }
}

impl Drop for Events {
    fn drop(&mut self) {
        self.queue.close();
        // Pending events may hold images.
        self.queue.change(|q| q.events.clear());
    }
}

#[cfg(test)]
mod tests;

//! The driver for cameras: tracking, detection, mapping and looping, each on a thread of its own.
//!
//! Answers: how the stages run side by side in real time, how long a frame took, and what happened to the threads. The only library
//! whose results depend on the clock, and the only one that holds a lock (the stages' mailboxes). Decides when a stage takes a message and nothing else: what
//! becomes of it is the stages' business, and the order in which messages were taken is logged, so that
//! [`Replay`](stillpoint_slam::Replay) runs it again, bit for bit.
//!
//! Who waits for whom goes one way only: detection waits for room at tracking, tracking at mapping, mapping at looping, and
//! looping for none. Views, places and corrections go the other way, and these are never waited for: of views and places the newest
//! replaces the older one, and of corrections there is one at a time. No stage waits for a listener: each subscriber has a queue, and chooses
//! what is dropped when the queue is full ([`Delivery`]).

mod audience;
mod backoff;
mod boxes;
mod budget;
mod detection;
mod health;
mod mailbox;
mod measure;
mod pace;
mod recorder;
mod system;
mod threads;
mod workers;

pub use audience::{Delivery, Events, Missed, Subscribed};
pub use health::{LiveHealth, ThreadState, Watch};
pub use measure::{AnswerTiming, Ended, FrameTiming, LiveStatistics, Stage, WorkerEnd};
pub use pace::Played;
pub use system::{LiveOptions, LiveResult, LiveSystem, SubscriberHook};
pub use workers::Hook;

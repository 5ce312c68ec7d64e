//! The driver for live cameras: tracking, detection, mapping and looping, each on its own thread.
//!
//! The only library whose results depend on the clock, and the only one with a lock (the stages' mailboxes). It only decides when a stage
//! takes a message; the order in which messages were taken is logged, so that [`Replay`](stillpoint_slam::Replay) repeats the run, bit for
//! bit.
//!
//! Waiting has one direction: detection waits for room at tracking, tracking at mapping, mapping at looping, and looping for none. Views,
//! places and corrections go the other way without waiting: the newest view and places replace older ones, and there is at most one
//! correction at a time. No stage waits for a subscriber: each has a queue, and drops events by its own rule when the queue is full
//! ([`Delivery`]).

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

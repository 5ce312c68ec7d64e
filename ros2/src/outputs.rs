//! The topics that the node publishes.

use crate::bus::{Bus, BusError, Quality, Writer};
use crate::names::{NodeName, Remap, resolve};
use std::collections::BTreeMap;
use stillpoint::ros_events::{Outgoing, Topic};

/// Messages that wait for a reliable subscriber at most.
const DEPTH: u16 = 30;

/// A writer for each topic.
pub struct Outputs(BTreeMap<Topic, Writer>);

/// The name of a topic, before it is renamed: those of the node itself are in its own namespace.
#[must_use]
pub fn name_of(topic: Topic) -> String {
    match topic.name().strip_prefix("/stillpoint/") {
        Some(own) => format!("~/{own}"),
        None => topic.name().to_owned(),
    }
}

/// How a topic is delivered.
fn quality(topic: Topic) -> Quality {
    if topic == Topic::TfStatic {
        // Several constant transforms may be sent one after the other, and each is to reach who comes later.
        return Quality {
            depth: 10,
            ..Quality::LATCHED
        };
    }
    if topic.is_latched() {
        return Quality::LATCHED;
    }
    Quality {
        depth: DEPTH,
        ..Quality::DEFAULT
    }
}

impl Outputs {
    /// Offers all topics.
    ///
    /// # Errors
    /// What the middleware says.
    pub fn offer(bus: &mut Bus, node: &NodeName, remaps: &[Remap]) -> Result<Self, BusError> {
        let mut writers = BTreeMap::new();
        for topic in Topic::ALL {
            let name = resolve(&name_of(topic), node, remaps);
            let writer = bus.publish(&name, topic.type_name(), quality(topic))?;
            writers.insert(topic, writer);
        }
        Ok(Self(writers))
    }

    /// Sends a message. What is constant, or latched for who comes later, is sent whether or not somebody is there.
    pub fn send(&self, message: &Outgoing) {
        if let Some(writer) = self.0.get(&message.topic)
            && (message.topic.is_latched() || writer.subscribers() > 0)
        {
            writer.send(&message.bytes);
        }
    }

    /// Whether somebody is there for a topic.
    #[must_use]
    pub fn has_subscribers(&self, topic: Topic) -> bool {
        self.0.get(&topic).is_some_and(|w| w.subscribers() > 0)
    }
}

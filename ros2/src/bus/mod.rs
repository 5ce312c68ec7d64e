//! The wire: topics and services of ROS 2 over RTPS, with messages as bytes.
//!
//! Answers: how bytes reach other nodes and theirs come here, and who is there. Knows no message and no frame.

mod discovery;
mod raw;
mod service;

pub use raw::{Reader, Received, Writer};
pub use service::{Request, Service};

use crate::bus::raw::RawAdapter;
use crate::names::{NodeName, topic_on_wire, type_on_wire};
use discovery::Discovery;
use rustdds::mio1::{Events, Interest, Poll, Token};
use rustdds::policy::{Durability, History, Reliability};
use rustdds::{
    DomainParticipant, DomainParticipantBuilder, DomainParticipantStatusEvent,
    DomainParticipantStatusListener, GUID, Publisher, QosPolicies, QosPolicyBuilder, StatusEvented,
    Subscriber, TopicKind,
};
use std::collections::{BTreeMap, BTreeSet};
use std::net::{IpAddr, Ipv4Addr};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

/// How messages of a topic are delivered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Quality {
    /// What was lost is sent again.
    pub reliable: bool,
    /// Who comes later gets what was sent before.
    pub latched: bool,
    /// Messages that wait at most.
    pub depth: u16,
}

impl Quality {
    /// Of sensors: what is lost is lost.
    pub const SENSOR: Self = Self {
        reliable: false,
        latched: false,
        depth: 10,
    };
    /// What ROS 2 does unless it is told otherwise.
    pub const DEFAULT: Self = Self {
        reliable: true,
        latched: false,
        depth: 10,
    };
    /// For maps and constant transforms.
    pub const LATCHED: Self = Self {
        reliable: true,
        latched: true,
        depth: 1,
    };

    fn policies(self) -> QosPolicies {
        let reliability = if self.reliable {
            Reliability::Reliable {
                max_blocking_time: rustdds::Duration::from_millis(100),
            }
        } else {
            Reliability::BestEffort
        };
        let durability = if self.latched {
            Durability::TransientLocal
        } else {
            Durability::Volatile
        };
        QosPolicyBuilder::new()
            .reliability(reliability)
            .durability(durability)
            .history(History::KeepLast {
                depth: self.depth.into(),
            })
            .build()
    }
}

/// Where nodes are looked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reach {
    /// `ROS_DOMAIN_ID`.
    pub domain: u16,
    /// Only this machine.
    pub local_only: bool,
}

impl Reach {
    /// As the environment says: `ROS_DOMAIN_ID`, `ROS_AUTOMATIC_DISCOVERY_RANGE`, and `ROS_LOCALHOST_ONLY` of older versions, which wins.
    ///
    /// # Errors
    /// Values that they cannot have.
    pub fn of_environment(get: impl Fn(&str) -> Option<String>) -> Result<Self, String> {
        let set = |name: &str| get(name).filter(|v| !v.is_empty());
        let domain = match set("ROS_DOMAIN_ID") {
            None => 0,
            Some(text) => text
                .trim()
                .parse()
                .ok()
                .filter(|d| *d <= 232)
                .ok_or_else(|| {
                    format!("ROS_DOMAIN_ID: expected a number from 0 to 232, found \"{text}\"")
                })?,
        };
        let only = set("ROS_LOCALHOST_ONLY").map(|v| v == "1");
        let range = set("ROS_AUTOMATIC_DISCOVERY_RANGE").map(|v| v.to_ascii_uppercase());
        let by_range = match range.as_deref() {
            None | Some("SUBNET" | "SYSTEM_DEFAULT" | "NOT_SET") => false,
            // Nobody is looked for by multicast either way; other nodes of this machine are found by their ports.
            Some("LOCALHOST" | "OFF") => true,
            Some(other) => {
                return Err(format!(
                    "ROS_AUTOMATIC_DISCOVERY_RANGE: expected SUBNET, LOCALHOST, OFF or SYSTEM_DEFAULT, found \"{other}\""
                ));
            }
        };
        Ok(Self {
            domain,
            local_only: only.unwrap_or(by_range),
        })
    }
}

/// Why something is not on the wire.
#[derive(Debug, thiserror::Error)]
#[error(
    "{what}: expected to be offered to other nodes, found: {reason}; check the network and ROS_DOMAIN_ID"
)]
pub struct BusError {
    /// The topic, service or node.
    pub what: String,
    /// What the middleware says.
    pub reason: String,
}

impl BusError {
    fn of(what: &str) -> impl Fn(rustdds::dds::CreateError) -> Self + '_ {
        move |e| Self {
            what: what.to_owned(),
            reason: format!("{e:?}"),
        }
    }
}

/// How many are at the other ends of a writer or reader.
#[derive(Clone, Debug, Default)]
pub struct Others(Arc<AtomicUsize>);

impl Others {
    /// As of now.
    #[must_use]
    pub fn count(&self) -> usize {
        self.0.load(Ordering::Relaxed)
    }
}

/// The ends here, and who is at the others.
#[derive(Default)]
struct Matches {
    of: BTreeMap<GUID, (BTreeSet<GUID>, Others)>,
}

impl Matches {
    fn track(&mut self, own: GUID) -> Others {
        let others = Others::default();
        self.of.insert(own, (BTreeSet::new(), others.clone()));
        others
    }

    fn matched(&mut self, own: GUID, other: GUID) {
        // The node itself is nobody else.
        if own.prefix == other.prefix {
            return;
        }
        if let Some((all, count)) = self.of.get_mut(&own) {
            all.insert(other);
            count.0.store(all.len(), Ordering::Relaxed);
        }
    }

    fn lost(&mut self, other: GUID) {
        for (all, count) in self.of.values_mut() {
            if all.remove(&other) {
                count.0.store(all.len(), Ordering::Relaxed);
            }
        }
    }
}

/// A node's place among others.
pub struct Bus {
    node: NodeName,
    participant: DomainParticipant,
    publisher: Publisher,
    subscriber: Subscriber,
    status: DomainParticipantStatusListener,
    poll: Poll,
    events: Events,
    tokens: usize,
    matches: Matches,
    discovery: Discovery,
    /// What publishers and subscribers offered or asked for that does not go together.
    misfits: Vec<GUID>,
}

impl Bus {
    /// Becomes visible to others.
    ///
    /// # Errors
    /// No network, or no free port.
    pub fn join(node: &NodeName, reach: Reach) -> Result<Self, BusError> {
        let name = node.full();
        let refuse = BusError::of(&name);
        let mut builder = DomainParticipantBuilder::new(reach.domain);
        if reach.local_only {
            builder = builder.with_only_networks([IpAddr::V4(Ipv4Addr::LOCALHOST)]);
        }
        let participant = builder.build().map_err(&refuse)?;
        let qos = Quality::DEFAULT.policies();
        let publisher = participant.create_publisher(&qos).map_err(&refuse)?;
        let subscriber = participant.create_subscriber(&qos).map_err(&refuse)?;
        let io = |e: std::io::Error| BusError {
            what: name.clone(),
            reason: e.to_string(),
        };
        let poll = Poll::new().map_err(io)?;
        let mut status = participant.status_listener();
        poll.registry()
            .register(status.as_status_source_mio1(), Token(0), Interest::READABLE)
            .map_err(io)?;
        let discovery = Discovery::new(&participant, &publisher, node)?;
        Ok(Self {
            node: node.clone(),
            participant,
            publisher,
            subscriber,
            status,
            poll,
            events: Events::with_capacity(64),
            tokens: 1,
            matches: Matches::default(),
            discovery,
            misfits: Vec::new(),
        })
    }

    /// Offers a topic. `name` is the whole name, `type_name` as `sensor_msgs/msg/Image`.
    ///
    /// # Errors
    /// What the middleware says.
    pub fn publish(
        &mut self,
        name: &str,
        type_name: &str,
        quality: Quality,
    ) -> Result<Writer, BusError> {
        let writer = self.writer(&topic_on_wire(name), &type_on_wire(type_name), quality)?;
        let others = self.matches.track(writer.guid());
        Ok(writer.with_others(others))
    }

    /// Subscribes to a topic.
    ///
    /// # Errors
    /// What the middleware says.
    pub fn subscribe(
        &mut self,
        name: &str,
        type_name: &str,
        quality: Quality,
    ) -> Result<Reader, BusError> {
        let reader = self.reader(&topic_on_wire(name), &type_on_wire(type_name), quality)?;
        let others = self.matches.track(reader.guid());
        Ok(reader.with_others(others))
    }

    fn topic(
        &self,
        topic: &str,
        type_name: &str,
        qos: &QosPolicies,
    ) -> Result<rustdds::Topic, BusError> {
        self.participant
            .create_topic(
                topic.to_owned(),
                type_name.to_owned(),
                qos,
                TopicKind::NoKey,
            )
            .map_err(BusError::of(topic))
    }

    fn writer(
        &mut self,
        topic: &str,
        type_name: &str,
        quality: Quality,
    ) -> Result<Writer, BusError> {
        let qos = quality.policies();
        let on_wire = self.topic(topic, type_name, &qos)?;
        let inner = self
            .publisher
            .create_datawriter_no_key::<_, RawAdapter>(&on_wire, Some(qos))
            .map_err(BusError::of(topic))?;
        let writer = Writer::new(inner);
        self.discovery.has_writer(writer.guid());
        Ok(writer)
    }

    fn reader(
        &mut self,
        topic: &str,
        type_name: &str,
        quality: Quality,
    ) -> Result<Reader, BusError> {
        let qos = quality.policies();
        let on_wire = self.topic(topic, type_name, &qos)?;
        let mut inner = self
            .subscriber
            .create_simple_datareader_no_key::<_, RawAdapter>(&on_wire, Some(qos))
            .map_err(BusError::of(topic))?;
        let token = Token(self.tokens);
        self.tokens += 1;
        self.poll
            .registry()
            .register(&mut inner, token, Interest::READABLE)
            .map_err(|e| BusError {
                what: topic.to_owned(),
                reason: e.to_string(),
            })?;
        let reader = Reader::new(inner);
        self.discovery.has_reader(reader.guid());
        Ok(reader)
    }

    /// Tells others which topics and services are this node's. To be called when all are there.
    ///
    /// # Errors
    /// What the middleware says.
    pub fn announce(&mut self) -> Result<(), BusError> {
        self.discovery.announce()
    }

    /// Waits until something may have come, at most so long, and takes note of who came and went.
    pub fn wait(&mut self, most: Duration) {
        // Interrupted by a signal: whoever waits looks why.
        let _ = self.poll.poll(&mut self.events, Some(most));
        while let Some(event) = self.status.try_recv_status() {
            match event {
                DomainParticipantStatusEvent::RemoteReaderMatched {
                    local_writer,
                    remote_reader,
                } => self.matches.matched(local_writer, remote_reader),
                DomainParticipantStatusEvent::RemoteWriterMatched {
                    local_reader,
                    remote_writer,
                } => self.matches.matched(local_reader, remote_writer),
                DomainParticipantStatusEvent::ReaderLost { guid, .. }
                | DomainParticipantStatusEvent::WriterLost { guid, .. } => self.matches.lost(guid),
                DomainParticipantStatusEvent::RemoteWriterQosIncompatible {
                    local_reader, ..
                } => self.misfits.push(local_reader),
                _ => {}
            }
        }
    }

    /// Whether a publisher of this reader's topic offers less than the reader asks for; each time is told once.
    pub fn take_misfit(&mut self, reader: &Reader) -> bool {
        let before = self.misfits.len();
        self.misfits.retain(|guid| *guid != reader.guid());
        self.misfits.len() < before
    }

    /// The node.
    #[must_use]
    pub fn node(&self) -> &NodeName {
        &self.node
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn reach(set: &[(&str, &str)]) -> Result<Reach, String> {
        Reach::of_environment(|name| {
            let found = set.iter().find(|(n, _)| *n == name);
            found.map(|(_, v)| (*v).to_owned())
        })
    }

    #[test]
    fn the_environment_is_honoured() {
        let expect = |set: &[(&str, &str)], domain, local_only| {
            assert_eq!(reach(set), Ok(Reach { domain, local_only }), "{set:?}");
        };
        expect(&[], 0, false);
        expect(&[("ROS_DOMAIN_ID", "42")], 42, false);
        expect(&[("ROS_LOCALHOST_ONLY", "1")], 0, true);
        expect(&[("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")], 0, true);
        expect(&[("ROS_AUTOMATIC_DISCOVERY_RANGE", "subnet")], 0, false);
        let both = [
            ("ROS_LOCALHOST_ONLY", "0"),
            ("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST"),
        ];
        expect(&both, 0, false);
        assert!(reach(&[("ROS_DOMAIN_ID", "233")]).is_err());
        assert!(reach(&[("ROS_DOMAIN_ID", "x")]).is_err());
        assert!(reach(&[("ROS_AUTOMATIC_DISCOVERY_RANGE", "MOON")]).is_err());
    }
}

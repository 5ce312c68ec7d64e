//! Topics and services of ROS 2 over RTPS, with messages as bytes, and discovery of other nodes.

mod discovery;
mod matches;
mod quality;
mod raw;
mod reach;
mod service;

pub use matches::Others;
pub use quality::Quality;
pub use raw::{Reader, Received, Writer};
pub use reach::Reach;
pub use service::{Request, Service};

use crate::bus::raw::RawAdapter;
use crate::names::{NodeName, topic_on_wire, type_on_wire};
use discovery::Discovery;
use matches::Matches;
use rustdds::mio1::{Events, Interest, Poll, Token};
use rustdds::{
    DomainParticipant, DomainParticipantBuilder, DomainParticipantStatusEvent,
    DomainParticipantStatusListener, GUID, Publisher, QosPolicies, StatusEvented, Subscriber,
    TopicKind,
};
use std::collections::BTreeMap;
use std::net::{IpAddr, Ipv4Addr};
use std::time::Duration;

/// A failure of the middleware.
#[derive(Debug, thiserror::Error)]
#[error(
    "{what}: expected to be offered to other nodes, found: {reason}; check the network and ROS_DOMAIN_ID"
)]
pub struct BusError {
    /// The topic, service or node.
    pub what: String,
    /// Message of the middleware.
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

/// A participant of the network.
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
    /// Hashes of types, by their names.
    hashes: BTreeMap<String, String>,
    /// Local readers with incompatible quality of service, not yet reported.
    misfits: Vec<GUID>,
}

impl Bus {
    /// Joins the network. `hashes` are those of the topics' types, by names such as `sensor_msgs/msg/Image`.
    ///
    /// # Errors
    /// No network, or no free port.
    pub fn join(
        node: &NodeName,
        reach: Reach,
        hashes: BTreeMap<String, String>,
    ) -> Result<Self, BusError> {
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
            hashes,
            misfits: Vec::new(),
        })
    }

    /// Creates a writer. `name` is the full name, `type_name` such as `sensor_msgs/msg/Image`.
    ///
    /// # Errors
    /// Failures of the middleware.
    pub fn publish(
        &mut self,
        name: &str,
        type_name: &str,
        quality: Quality,
    ) -> Result<Writer, BusError> {
        let writer = self.writer(&topic_on_wire(name), type_name, quality)?;
        let others = self.matches.track(writer.guid());
        Ok(writer.with_others(others))
    }

    /// Creates a reader.
    ///
    /// # Errors
    /// Failures of the middleware.
    pub fn subscribe(
        &mut self,
        name: &str,
        type_name: &str,
        quality: Quality,
    ) -> Result<Reader, BusError> {
        let reader = self.reader(&topic_on_wire(name), type_name, quality)?;
        let others = self.matches.track(reader.guid());
        Ok(reader.with_others(others))
    }

    fn topic(
        &self,
        topic: &str,
        type_name: &str,
        qos: &QosPolicies,
    ) -> Result<rustdds::Topic, BusError> {
        let on_wire = self.participant.create_topic(
            topic.to_owned(),
            type_on_wire(type_name),
            qos,
            TopicKind::NoKey,
        );
        let on_wire = on_wire.map_err(BusError::of(topic))?;
        Ok(match self.hashes.get(type_name) {
            Some(hash) => on_wire.with_endpoint_user_data(&user_data(hash)),
            None => on_wire,
        })
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

    /// Announces the topics and services of the node. Call it after creating all of them.
    ///
    /// # Errors
    /// Failures of the middleware.
    pub fn announce(&mut self) -> Result<(), BusError> {
        self.discovery.announce()
    }

    /// Waits for messages or until the timeout, and processes discovery events.
    pub fn wait(&mut self, most: Duration) {
        // A signal may interrupt the wait; the waiting caller checks for it.
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

    /// Whether a publisher offers incompatible quality of service; each event is reported once.
    pub fn take_misfit(&mut self, reader: &Reader) -> bool {
        let before = self.misfits.len();
        self.misfits.retain(|guid| *guid != reader.guid());
        self.misfits.len() < before
    }

    /// Name of the node.
    #[must_use]
    pub fn node(&self) -> &NodeName {
        &self.node
    }
}

/// User data with the type's hash, as announced since Iron (`rmw_dds_common`).
fn user_data(hash: &str) -> Vec<u8> {
    format!("typehash={hash};").into_bytes()
}

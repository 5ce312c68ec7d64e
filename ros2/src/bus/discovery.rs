//! Announces the node's readers and writers, for `ros2 node list` and `ros2 node info` ("Node to Participant mapping", design.ros2.org).

use crate::bus::raw::RawAdapter;
use crate::bus::{BusError, Quality, Writer};
use crate::names::NodeName;
use rustdds::{DomainParticipant, GUID, Publisher, RTPSEntity, TopicKind};

const TOPIC: &str = "ros_discovery_info";
const TYPE: &str = "rmw_dds_common::msg::dds_::ParticipantEntitiesInfo_";

pub(crate) struct Discovery {
    participant: GUID,
    node: NodeName,
    readers: Vec<GUID>,
    writers: Vec<GUID>,
    writer: Writer,
}

impl Discovery {
    pub(crate) fn new(
        participant: &DomainParticipant,
        publisher: &Publisher,
        node: &NodeName,
    ) -> Result<Self, BusError> {
        let qos = Quality::LATCHED.policies();
        let topic = participant
            .create_topic(TOPIC.to_owned(), TYPE.to_owned(), &qos, TopicKind::NoKey)
            .map_err(BusError::of(TOPIC))?;
        let inner = publisher
            .create_datawriter_no_key::<_, RawAdapter>(&topic, Some(qos))
            .map_err(BusError::of(TOPIC))?;
        Ok(Self {
            participant: participant.guid(),
            node: node.clone(),
            readers: Vec::new(),
            writers: Vec::new(),
            writer: Writer::new(inner),
        })
    }

    pub(crate) fn has_reader(&mut self, guid: GUID) {
        self.readers.push(guid);
    }

    pub(crate) fn has_writer(&mut self, guid: GUID) {
        self.writers.push(guid);
    }

    pub(crate) fn announce(&self) -> Result<(), BusError> {
        let bytes = message(
            &self.participant.to_bytes(),
            &self.node,
            &self.readers.iter().map(GUID::to_bytes).collect::<Vec<_>>(),
            &self.writers.iter().map(GUID::to_bytes).collect::<Vec<_>>(),
        );
        if self.writer.send(&bytes) {
            return Ok(());
        }
        Err(BusError {
            what: TOPIC.to_owned(),
            reason: "the message was not taken".to_owned(),
        })
    }
}

/// `rmw_dds_common/msg/ParticipantEntitiesInfo` of one node, with ids of 16 bytes, as since Iron.
fn message(
    participant: &[u8; 16],
    node: &NodeName,
    readers: &[[u8; 16]],
    writers: &[[u8; 16]],
) -> Vec<u8> {
    let mut bytes = vec![0, 1, 0, 0];
    bytes.extend_from_slice(participant);
    let number = |bytes: &mut Vec<u8>, n: usize| {
        let padding = (bytes.len() - 4).next_multiple_of(4) - (bytes.len() - 4);
        bytes.resize(bytes.len() + padding, 0);
        bytes.extend_from_slice(&(n as u32).to_le_bytes());
    };
    number(&mut bytes, 1);
    for text in [&node.namespace, &node.name] {
        number(&mut bytes, text.len() + 1);
        bytes.extend_from_slice(text.as_bytes());
        bytes.push(0);
    }
    for list in [readers, writers] {
        number(&mut bytes, list.len());
        list.iter().for_each(|guid| bytes.extend_from_slice(guid));
    }
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn discovery_message_matches_rmw() {
        let node = NodeName {
            namespace: "/".into(),
            name: "eyes".into(),
        };
        let bytes = message(&[1; 16], &node, &[[2; 16]], &[[3; 16], [4; 16]]);
        let mut expected = vec![0, 1, 0, 0];
        expected.extend([1; 16]);
        expected.extend([1, 0, 0, 0, 2, 0, 0, 0, b'/', 0, 0, 0]);
        expected.extend([5, 0, 0, 0, b'e', b'y', b'e', b's', 0, 0, 0, 0]);
        expected.extend([1, 0, 0, 0]);
        expected.extend([2; 16]);
        expected.extend([2, 0, 0, 0]);
        expected.extend([3; 16]);
        expected.extend([4; 16]);
        assert_eq!(bytes, expected);
    }
}

//! Services: a topic of requests and one of answers.
//!
//! Answers refer to requests in two ways. Fast DDS and RustDDS send the request's identity beside the message ("enhanced" mapping of
//! DDS-RPC); rmw_cyclonedds prepends half of the client's id and a number. A client's id begins with the vendor's number, two bytes.

use crate::bus::{Bus, BusError, Quality, Reader, Received, Writer};
use crate::names::service_on_wire;
use rustdds::rpc::SampleIdentity;
use rustdds::{GUID, SequenceNumber};

/// First bytes of ids of Eclipse Cyclone DDS.
const CYCLONE: [u8; 2] = [0x01, 0x10];
/// After the encapsulation header: half an id, and a number.
const CYCLONE_HEADER: std::ops::Range<usize> = 4..20;

/// A service server.
pub struct Service {
    requests: Reader,
    answers: Writer,
}

/// A pending request.
#[derive(Clone, Debug)]
pub struct Request {
    /// The message in CDR with its encapsulation header.
    pub bytes: Vec<u8>,
    client: Client,
}

#[derive(Clone, Debug)]
enum Client {
    Enhanced(SampleIdentity),
    Cyclone([u8; 16]),
}

impl Bus {
    /// Creates a service server. `type_name` such as `std_srvs/srv/Trigger`.
    ///
    /// # Errors
    /// Failures of the middleware.
    pub fn serve(&mut self, name: &str, type_name: &str) -> Result<Service, BusError> {
        let [requests, answers] = service_on_wire(name);
        let of = |half: &str| format!("{type_name}_{half}");
        Ok(Service {
            answers: self.writer(&answers, &of("Response"), Quality::DEFAULT)?,
            requests: self.reader(&requests, &of("Request"), Quality::DEFAULT)?,
        })
    }
}

impl Service {
    /// The next request, if available.
    pub fn take(&self) -> Option<Request> {
        loop {
            let request = understand(self.requests.take()?);
            if request.is_some() {
                return request;
            }
        }
    }

    /// Answers a request, with a message in CDR with its encapsulation header.
    pub fn answer(&self, request: &Request, message: &[u8]) {
        // Fails only if the client is gone.
        let _ = match &request.client {
            Client::Enhanced(identity) => self.answers.answer(message.to_vec(), Some(*identity)),
            Client::Cyclone(header) => {
                let (encapsulation, body) = message.split_at(CYCLONE_HEADER.start);
                let bytes = [encapsulation, header, body].concat();
                self.answers.answer(bytes, None)
            }
        };
    }
}

/// Parses a request; `None` if it is too short.
fn understand(received: Received) -> Option<Request> {
    let id = received.identity.writer_guid.to_bytes();
    if id[..2] == CYCLONE {
        let header = received.bytes.get(CYCLONE_HEADER)?.try_into().ok()?;
        // Removing the 16 bytes of the header keeps alignment to eight bytes.
        let bytes = [
            &received.bytes[..CYCLONE_HEADER.start],
            &received.bytes[CYCLONE_HEADER.end..],
        ];
        return Some(Request {
            bytes: bytes.concat(),
            client: Client::Cyclone(header),
        });
    }
    let mut identity = received.related.unwrap_or(received.identity);
    // Fast DDS gives the reader of the answer, but no number.
    if identity.sequence_number == SequenceNumber::UNKNOWN {
        identity.sequence_number = received.identity.sequence_number;
    }
    if identity.writer_guid == GUID::GUID_UNKNOWN {
        identity.writer_guid = received.identity.writer_guid;
    }
    Some(Request {
        bytes: received.bytes,
        client: Client::Enhanced(identity),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn received(vendor: u8, bytes: Vec<u8>, related: Option<SampleIdentity>) -> Received {
        let mut id = [7; 16];
        id[..2].copy_from_slice(&[1, vendor]);
        Received {
            bytes,
            at: rustdds::Timestamp::now(),
            identity: SampleIdentity {
                writer_guid: GUID::from_bytes(id),
                sequence_number: SequenceNumber::new(5),
            },
            related,
        }
    }

    #[test]
    fn requests_of_both_identity_mappings_are_read() {
        let mut bytes = vec![0, 1, 0, 0];
        bytes.extend(1..=16);
        bytes.push(99);
        let request = understand(received(0x10, bytes, None)).unwrap();
        assert_eq!(request.bytes, [0, 1, 0, 0, 99]);
        assert!(matches!(request.client, Client::Cyclone(h) if h[0] == 1 && h[15] == 16));
        assert!(understand(received(0x10, vec![0, 1, 0, 0, 1], None)).is_none());
        let reader = SampleIdentity {
            writer_guid: GUID::from_bytes([9; 16]),
            sequence_number: SequenceNumber::UNKNOWN,
        };
        let request = understand(received(0x0f, vec![0, 1, 0, 0, 1], Some(reader))).unwrap();
        let Client::Enhanced(identity) = request.client else {
            panic!("{request:?}");
        };
        assert_eq!(identity.writer_guid, GUID::from_bytes([9; 16]));
        assert_eq!(identity.sequence_number, SequenceNumber::new(5));
    }
}

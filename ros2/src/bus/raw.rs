//! Messages as bytes: they are serialised by `ros-messages`, not by the middleware.

use crate::bus::Others;
use rustdds::bytes::Bytes;
use rustdds::dds::no_key::DeserializedCacheChange;
use rustdds::no_key::{
    DataWriter, Decode, DefaultDecoder, DeserializerAdapter, SerializerAdapter, SimpleDataReader,
};
use rustdds::rpc::SampleIdentity;
use rustdds::{GUID, RTPSEntity, RepresentationIdentifier, Timestamp, WriteOptionsBuilder};
use std::convert::Infallible;
use std::time::Duration;

/// A message with its encapsulation header, as in recordings.
#[derive(Clone, Debug)]
pub(crate) struct Raw(Vec<u8>);

pub(crate) struct RawAdapter;

/// Length of the encapsulation header: two bytes of kind, two of options.
const HEADER: usize = 4;

impl SerializerAdapter<Raw> for RawAdapter {
    type Error = Infallible;

    fn output_encoding() -> RepresentationIdentifier {
        RepresentationIdentifier::CDR_LE
    }

    fn to_bytes(value: &Raw) -> Result<Bytes, Infallible> {
        Ok(Bytes::copy_from_slice(value.0.get(HEADER..).unwrap_or(&[])))
    }
}

impl DeserializerAdapter<Raw> for RawAdapter {
    type Error = Infallible;
    type Decoded = Raw;

    fn supported_encodings() -> &'static [RepresentationIdentifier] {
        &[
            RepresentationIdentifier::CDR_LE,
            RepresentationIdentifier::CDR_BE,
        ]
    }

    fn transform_decoded(decoded: Raw) -> Raw {
        decoded
    }
}

impl DefaultDecoder<Raw> for RawAdapter {
    type Decoder = Copying;
    const DECODER: Copying = Copying;
}

#[derive(Clone)]
pub(crate) struct Copying;

impl<'de> Decode<'de, Raw> for Copying {
    type Error = Infallible;

    fn decode_bytes(
        self,
        input: &'de [u8],
        encoding: RepresentationIdentifier,
    ) -> Result<Raw, Infallible> {
        let little = encoding == RepresentationIdentifier::CDR_LE;
        let mut bytes = Vec::with_capacity(HEADER + input.len());
        bytes.extend_from_slice(&[0, u8::from(little), 0, 0]);
        bytes.extend_from_slice(input);
        Ok(Raw(bytes))
    }
}

/// A received message.
#[derive(Clone, Debug)]
pub struct Received {
    /// CDR with its encapsulation header.
    pub bytes: Vec<u8>,
    /// Arrival time of its last packet.
    pub(crate) at: Timestamp,
    /// Its writer and sequence number.
    pub(crate) identity: SampleIdentity,
    /// The message it answers, or the identity for its answer.
    pub(crate) related: Option<SampleIdentity>,
}

impl Received {
    /// Time since the arrival of its last packet.
    #[must_use]
    pub fn age(&self) -> Duration {
        let ticks = Timestamp::now()
            .to_ticks()
            .saturating_sub(self.at.to_ticks());
        // Ticks of RTPS: 2^-32 s.
        Duration::from_secs_f64(ticks as f64 / (1u64 << 32) as f64)
    }

    /// Its writer, and its sequence number, which increases by one per message.
    #[must_use]
    pub fn number(&self) -> ([u8; 16], i64) {
        let identity = &self.identity;
        let number = i64::from(identity.sequence_number);
        (identity.writer_guid.to_bytes(), number)
    }
}

/// Reader of a topic.
pub struct Reader {
    inner: SimpleDataReader<Raw, RawAdapter>,
    others: Others,
}

impl Reader {
    pub(crate) fn new(inner: SimpleDataReader<Raw, RawAdapter>) -> Self {
        Self {
            inner,
            others: Others::default(),
        }
    }

    pub(crate) fn with_others(self, others: Others) -> Self {
        Self { others, ..self }
    }

    pub(crate) fn guid(&self) -> GUID {
        self.inner.guid()
    }

    /// Number of matched publishers.
    #[must_use]
    pub fn publishers(&self) -> usize {
        self.others.count()
    }

    /// The next message, if available. Skips samples that are not messages.
    pub fn take(&self) -> Option<Received> {
        self.inner.drain_read_notifications();
        // An error removes one sample; the limit is never reached.
        for _ in 0..1000 {
            match self.inner.try_take_one() {
                Ok(sample) => return sample.map(received),
                Err(_) => continue,
            }
        }
        None
    }
}

fn received(change: DeserializedCacheChange<Raw>) -> Received {
    Received {
        at: change.receive_instant,
        identity: SampleIdentity {
            writer_guid: change.writer_guid(),
            sequence_number: change.sequence_number,
        },
        related: change.related_sample_identity(),
        bytes: change.into_value().0,
    }
}

/// Writer of a topic.
pub struct Writer {
    inner: DataWriter<Raw, RawAdapter>,
    others: Others,
}

impl Writer {
    pub(crate) fn new(inner: DataWriter<Raw, RawAdapter>) -> Self {
        Self {
            inner,
            others: Others::default(),
        }
    }

    pub(crate) fn with_others(self, others: Others) -> Self {
        Self { others, ..self }
    }

    pub(crate) fn guid(&self) -> GUID {
        self.inner.guid()
    }

    /// GUID of the writer: 12 bytes of its participant, and 4 of its own.
    #[must_use]
    pub fn id(&self) -> [u8; 16] {
        self.inner.guid().to_bytes()
    }

    /// Number of matched subscribers.
    #[must_use]
    pub fn subscribers(&self) -> usize {
        self.others.count()
    }

    /// Sends CDR with its encapsulation header. Returns false if reliable readers do not keep up.
    pub fn send(&self, bytes: &[u8]) -> bool {
        self.inner.write(Raw(bytes.to_vec()), None).is_ok()
    }

    pub(crate) fn answer(&self, bytes: Vec<u8>, to: Option<SampleIdentity>) -> bool {
        let options = WriteOptionsBuilder::new().related_sample_identity_opt(to);
        self.inner
            .write_with_options(Raw(bytes), options.build())
            .is_ok()
    }
}

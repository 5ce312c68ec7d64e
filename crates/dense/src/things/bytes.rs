//! Serialises objects, as stored in a map file.
//!
//! Little-endian: `SPTHING3`; number of floors and of things (4 each); per floor its submap (4), the unit vector away from it and its
//! offset (4 doubles); per thing its class in COCO, from 0 (1), number of views in which it was found and in which it could have been (4
//! each), stamps of the first and the last one, largest depth (doubles), number of points (4), and per point a keyframe (4) and x, y, z in
//! its camera, mm (2 each); then the number of its unseen sides (1), and a point of each. Then the ground: number of cells (4), and per
//! cell a point as those of things, and whether it is a wall (1). `SPTHING2` lacks the unseen sides, and `SPTHING1` also the ground; both
//! are read.

use super::ThingMap;
use super::ground::Spot;
use super::part::{MOST_POINTS, MOST_SIDES, Point, Record};
use crate::floor::Floor;
use stillpoint_detection::ClassId;
use stillpoint_geometry::Vec3;
use stillpoint_map::{KeyframeId, SubmapId};

const MAGIC: &[u8; 8] = b"SPTHING3";
/// Version without unseen sides.
const WITHOUT_SIDES: &[u8; 8] = b"SPTHING2";
/// Version without unseen sides and ground.
const WITHOUT_GROUND: &[u8; 8] = b"SPTHING1";

/// Why bytes are not objects.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ThingBytesError {
    /// Wrong signature.
    #[error(
        "expected things (SPTHING1 to SPTHING3), found other bytes; gather them again with --things"
    )]
    Kind,
    /// Wrong size.
    #[error(
        "expected things that end with their bytes, found {0}; they are damaged: gather them again with --things"
    )]
    Length(String),
    /// An impossible value.
    #[error("expected things, found {0}; they are damaged: gather them again with --things")]
    Value(String),
}

impl ThingMap {
    /// Serialises the objects; equal objects give equal bytes.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut out = MAGIC.to_vec();
        for count in [self.levels.len(), self.records.len()] {
            out.extend((count as u32).to_le_bytes());
        }
        for (submap, floor) in &self.levels {
            out.extend(submap.0.to_le_bytes());
            for v in floor.up.iter().chain([&floor.offset]) {
                out.extend(v.to_le_bytes());
            }
        }
        for r in &self.records {
            out.push(r.class.0);
            for count in [r.found, r.expected] {
                out.extend(count.to_le_bytes());
            }
            for v in [r.seen[0], r.seen[1], r.farthest] {
                out.extend(v.to_le_bytes());
            }
            out.extend((r.points.len() as u32).to_le_bytes());
            r.points.iter().for_each(|p| put(p, &mut out));
            out.push(r.hidden.len() as u8);
            r.hidden.iter().for_each(|p| put(p, &mut out));
        }
        out.extend((self.ground.len() as u32).to_le_bytes());
        for spot in &self.ground {
            put(&spot.at, &mut out);
            out.push(u8::from(spot.wall));
        }
        out
    }

    /// Deserialises objects. Memory and time are proportional to the bytes.
    ///
    /// # Errors
    /// [`ThingBytesError`] for any invalid bytes.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, ThingBytesError> {
        let kinds = [WITHOUT_GROUND, WITHOUT_SIDES, MAGIC];
        let found = kinds.iter().position(|k| bytes.starts_with(*k));
        let kind = found.ok_or(ThingBytesError::Kind)?;
        let mut reader = Reader(&bytes[MAGIC.len()..]);
        let (levels, records) = (reader.word()?, reader.word()?);
        let mut map = Self::default();
        for _ in 0..levels {
            let submap = SubmapId(reader.word()?);
            let floor = reader.floor()?;
            let after = map.levels.last_key_value().is_none_or(|l| *l.0 < submap);
            if !after {
                return Err(value(format!(
                    "the floor of submap {} out of order",
                    submap.0
                )));
            }
            map.levels.insert(submap, floor);
        }
        for _ in 0..records {
            let mut record = reader.record()?;
            if kind > 1 {
                record.hidden = reader.sides()?;
            }
            map.records.push(record);
        }
        let spots = if kind > 0 { reader.word()? } else { 0 };
        for _ in 0..spots {
            let spot = reader.spot()?;
            map.ground.push(spot);
        }
        match reader.0.len() {
            0 => Ok(map),
            more => Err(ThingBytesError::Length(format!("{more} bytes more"))),
        }
    }
}

fn put(p: &Point, out: &mut Vec<u8>) {
    out.extend(p.keyframe.0.to_le_bytes());
    out.extend(p.at.iter().flat_map(|v| v.to_le_bytes()));
}

fn value(found: String) -> ThingBytesError {
    ThingBytesError::Value(found)
}

struct Reader<'a>(&'a [u8]);

impl Reader<'_> {
    fn take<const N: usize>(&mut self) -> Result<[u8; N], ThingBytesError> {
        let (head, rest) = self
            .0
            .split_first_chunk()
            .ok_or_else(|| ThingBytesError::Length("an early end".to_owned()))?;
        self.0 = rest;
        Ok(*head)
    }

    fn word(&mut self) -> Result<u32, ThingBytesError> {
        self.take().map(u32::from_le_bytes)
    }

    fn double(&mut self, what: &str, most: f64) -> Result<f64, ThingBytesError> {
        let v = f64::from_le_bytes(self.take()?);
        if v.is_finite() && v.abs() <= most {
            return Ok(v);
        }
        Err(value(format!("{what} of {v}")))
    }

    fn floor(&mut self) -> Result<Floor, ThingBytesError> {
        let mut up = Vec3::zeros();
        for k in 0..3 {
            up[k] = self.double("a direction", 1.1)?;
        }
        let offset = self.double("a floor's offset", 1e6)?;
        if (up.norm() - 1.0).abs() > 1e-6 {
            return Err(value(format!("a direction of length {}", up.norm())));
        }
        Ok(Floor { up, offset })
    }

    fn record(&mut self) -> Result<Record, ThingBytesError> {
        let [class] = self.take()?;
        if usize::from(class) >= ClassId::COUNT {
            return Err(value(format!("class {class} of {}", ClassId::COUNT)));
        }
        let (found, expected) = (self.word()?, self.word()?);
        let mut times = [0.0; 2];
        for time in &mut times {
            *time = self.double("a timestamp", f64::MAX)?;
        }
        let farthest = self.double("a depth", 100.0)?;
        let count = self.word()? as usize;
        if count > MOST_POINTS {
            return Err(value(format!("a thing of {count} points")));
        }
        let mut points = Vec::with_capacity(count);
        for _ in 0..count {
            points.push(self.point()?);
        }
        Ok(Record {
            class: ClassId(class),
            found,
            expected,
            seen: times,
            farthest,
            points,
            hidden: Vec::new(),
        })
    }

    fn sides(&mut self) -> Result<Vec<Point>, ThingBytesError> {
        let [count] = self.take()?;
        if usize::from(count) > MOST_SIDES {
            return Err(value(format!("a thing with {count} hidden sides")));
        }
        (0..count).map(|_| self.point()).collect()
    }

    fn point(&mut self) -> Result<Point, ThingBytesError> {
        Ok(Point {
            keyframe: KeyframeId(self.word()?),
            at: [self.half()?, self.half()?, self.half()?],
        })
    }

    fn spot(&mut self) -> Result<Spot, ThingBytesError> {
        let at = self.point()?;
        match self.take()? {
            [wall @ (0 | 1)] => Ok(Spot {
                at,
                wall: wall == 1,
            }),
            [other] => Err(value(format!("ground of kind {other}"))),
        }
    }

    fn half(&mut self) -> Result<i16, ThingBytesError> {
        self.take().map(i16::from_le_bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn spot(keyframe: u32, wall: bool) -> Spot {
        let at = Point {
            keyframe: KeyframeId(keyframe),
            at: [-1000, 250, 3],
        };
        Spot { at, wall }
    }

    fn map(records: Vec<Record>) -> ThingMap {
        let floor = Floor {
            up: -Vec3::y(),
            offset: -1.25,
        };
        ThingMap {
            records,
            levels: [(SubmapId(0), floor), (SubmapId(40), floor)].into(),
            ground: vec![spot(3, true), spot(4, false)],
        }
    }

    fn point(&(id, at): &(u32, [i16; 3])) -> Point {
        Point {
            keyframe: KeyframeId(id),
            at,
        }
    }

    fn record() -> impl Strategy<Value = Record> {
        let points = prop::collection::vec((any::<u32>(), any::<[i16; 3]>()), 0..9);
        (
            0..80_u8,
            any::<[u32; 2]>(),
            -1e9..1e9_f64,
            0.0..9.0_f64,
            points,
        )
            .prop_map(
                |(class, [found, expected], first, farthest, points)| Record {
                    class: ClassId(class),
                    found,
                    expected,
                    seen: [first, first + 1.0],
                    farthest,
                    hidden: points.iter().take(MOST_SIDES).map(point).collect(),
                    points: points.iter().map(point).collect(),
                },
            )
    }

    proptest! {
        #[test]
        fn things_round_trip_through_bytes(records in prop::collection::vec(record(), 0..5)) {
            let map = map(records);
            let bytes = map.to_bytes();
            prop_assert_eq!(ThingMap::from_bytes(&bytes), Ok(map));
            // Missing or additional bytes are errors.
            for cut in 0..bytes.len() {
                prop_assert!(ThingMap::from_bytes(&bytes[..cut]).is_err());
            }
            prop_assert!(ThingMap::from_bytes(&[&bytes[..], &[0]].concat()).is_err());
        }

        #[test]
        fn arbitrary_bytes_are_refused_or_read(tail in prop::collection::vec(any::<u8>(), 0..200), flip in 0..200_usize) {
            let _ = ThingMap::from_bytes(&tail);
            let _ = ThingMap::from_bytes(&[&MAGIC[..], &tail].concat());
            let mut bytes = map(Vec::new()).to_bytes();
            let at = flip % bytes.len();
            bytes[at] ^= 0x41;
            let _ = ThingMap::from_bytes(&bytes);
        }
    }

    #[test]
    fn damage_is_reported_in_words() {
        let said = |bytes: &[u8]| ThingMap::from_bytes(bytes).unwrap_err().to_string();
        assert!(
            said(b"SPDENSE2").contains("expected things (SPTHING1 to SPTHING3), found other bytes")
        );
        let mut bytes = map(Vec::new()).to_bytes();
        assert!(said(&bytes[..30]).contains("found an early end"));
        bytes[20..28].copy_from_slice(&f64::NAN.to_le_bytes());
        assert!(said(&bytes).contains("found a direction of NaN"));
        // The version without ground is read.
        let mut old = map(Vec::new());
        old.ground.clear();
        let bytes = old.to_bytes();
        let before = [WITHOUT_GROUND, &bytes[8..bytes.len() - 4]].concat();
        assert_eq!(ThingMap::from_bytes(&before), Ok(old));
        // The version without unseen sides is read.
        let mut old = map(vec![Record {
            class: ClassId(56),
            found: 5,
            expected: 7,
            seen: [1.0, 2.0],
            farthest: 2.5,
            points: vec![spot(3, true).at],
            hidden: Vec::new(),
        }]);
        old.ground.clear();
        let bytes = old.to_bytes();
        // Without the zero count of unseen sides before the number of cells.
        let (things, ground) = bytes.split_at(bytes.len() - 4);
        let before = [WITHOUT_SIDES, &things[8..things.len() - 1], ground].concat();
        assert_eq!(ThingMap::from_bytes(&before), Ok(old));
        // A count is checked against the remaining bytes.
        let mut bytes = map(Vec::new()).to_bytes();
        bytes[12..16].copy_from_slice(&u32::MAX.to_le_bytes());
        assert!(said(&bytes).contains("found an early end"));
    }
}

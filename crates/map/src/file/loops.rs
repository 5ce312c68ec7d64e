//! Stores loop edges as an extension, absent in maps without loops. Programs that do not know it ignore it.

use super::bytes::{Reader, Writer};
use super::{MapFileError, decode, encode, validate};
use crate::{KeyframeId, LoopEdge, Map};

/// The reserved name of the extension.
pub(super) const NAME: &str = "stillpoint/loops";
/// Bytes per loop: two ids, a pose, the upper triangle of the information matrix, a count.
const BYTES: usize = 4 + 4 + 7 * 8 + 21 * 8 + 4;

pub(super) fn to_bytes(map: &Map) -> Option<Vec<u8>> {
    let mut to = Writer::default();
    for edge in map.view.loops() {
        to.u32(edge.old.0);
        to.u32(edge.new.0);
        encode::pose(&mut to, &edge.old_from_new);
        for number in edge.triangle() {
            to.f64(number);
        }
        to.u32(edge.inliers);
    }
    (!to.bytes.is_empty()).then_some(to.bytes)
}

/// Decodes loops. Their keyframes are checked with the map.
pub(super) fn from_bytes(bytes: &[u8]) -> Result<Vec<LoopEdge>, MapFileError> {
    let mut from = Reader::new(NAME, bytes);
    let mut loops = Vec::new();
    for _ in 0..bytes.len() / BYTES {
        let (old, new) = (KeyframeId(from.u32()?), KeyframeId(from.u32()?));
        let old_from_new = decode::pose(&mut from)?;
        validate::pose(NAME, new, &old_from_new)?;
        let mut triangle = [0.0; 21];
        for number in &mut triangle {
            *number = from.f64()?;
        }
        loops.push(LoopEdge {
            old,
            new,
            old_from_new,
            information: LoopEdge::symmetric(&triangle),
            inliers: from.u32()?,
        });
    }
    from.end()?;
    Ok(loops)
}

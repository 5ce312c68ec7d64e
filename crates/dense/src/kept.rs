//! Frames kept for re-integration: compressed, and anchored to keyframes.

use crate::observation::Observation;
use stillpoint_geometry::Se3;
use stillpoint_imaging::{FrameId, rvl};
use stillpoint_map::{KeyframeId, MapView, SubmapId};

#[derive(Clone, Copy, Debug)]
pub(crate) struct Anchor {
    /// The keyframe that the frame became, if any.
    pub(crate) own: Option<KeyframeId>,
    /// The preceding keyframe, and the pose relative to it.
    pub(crate) reference: Option<(KeyframeId, Se3)>,
    pub(crate) online: Se3,
    pub(crate) submap: Option<SubmapId>,
}

impl Anchor {
    /// The pose and its submap in a version of the map; `None` if its keyframes were revoked.
    pub(crate) fn pose(&self, view: Option<&MapView>) -> Option<(Se3, Option<SubmapId>)> {
        let Some(view) = view else {
            return Some((self.online, self.submap));
        };
        if let Some((id, tail)) = self.hold(view) {
            let pose = view.world_from_keyframe(id)?;
            return Some((pose * tail, view.submap_of(id)));
        }
        // A missing keyframe will be added later, unless its id is already below the map's bound: then it was revoked.
        let id = self.own.or(self.reference.map(|r| r.0));
        let taken_back = id.is_some_and(|id| id.index() < view.keyframe_bound());
        (!taken_back).then_some((self.online, self.submap))
    }

    /// The keyframe that it is anchored to in a version of the map, and its pose in that keyframe's camera.
    pub(crate) fn hold(&self, view: &MapView) -> Option<(KeyframeId, Se3)> {
        let own = self.own.map(|id| (id, Se3::identity()));
        let mut holds = own.into_iter().chain(self.reference);
        holds.find(|(id, _)| view.world_from_keyframe(*id).is_some())
    }
}

pub(crate) struct Kept {
    pub(crate) frame: FrameId,
    pub(crate) depth_stamp: f64,
    pub(crate) anchor: Anchor,
    /// The pose with which it is integrated; `None` if it is not.
    pub(crate) used: Option<Se3>,
    size: [usize; 2],
    doubt: u8,
    depth: Box<[u8]>,
    movers: Box<[u8]>,
    colour: Box<[u8]>,
}

#[derive(Default)]
pub(crate) struct Packing {
    bytes: Vec<u8>,
}

impl Kept {
    pub(crate) fn pack(
        seen: &Observation,
        frame: FrameId,
        depth_stamp: f64,
        anchor: Anchor,
        packing: &mut Packing,
    ) -> Self {
        let mut pack = |values: &[u16]| {
            rvl::encode(values, &mut packing.bytes);
            Box::from(&*packing.bytes)
        };
        let rgb = |c: &u32| [*c as u8, (*c >> 8) as u8, (*c >> 16) as u8];
        Self {
            frame,
            depth_stamp,
            anchor,
            used: None,
            size: [seen.width, seen.height],
            doubt: seen.doubt,
            depth: pack(&seen.depth),
            movers: pack(&seen.movers),
            colour: seen.colour.iter().flat_map(rgb).collect(),
        }
    }

    pub(crate) fn unpack(&self, to: &mut Observation) {
        [to.width, to.height] = self.size;
        to.doubt = self.doubt;
        to.depth_stamp = self.depth_stamp;
        let movers = to.mover_width() * to.mover_height();
        // Data compressed here always decodes.
        let depth = rvl::decode(&self.depth, to.width * to.height, &mut to.depth);
        let moving = rvl::decode(&self.movers, movers, &mut to.movers);
        debug_assert!(depth.and(moving).is_some());
        to.colour.clear();
        let rgb = self.colour.chunks_exact(3);
        to.colour
            .extend(rgb.map(|c| u32::from(c[0]) | u32::from(c[1]) << 8 | u32::from(c[2]) << 16));
    }

    pub(crate) fn bytes(&self) -> usize {
        size_of::<Self>() + self.depth.len() + self.movers.len() + self.colour.len()
    }
}

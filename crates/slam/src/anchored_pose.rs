//! Frame poses that follow corrections of the map.

use stillpoint_geometry::Se3;
use stillpoint_map::{KeyframeId, MapView};

/// Camera pose of a frame, expressed relative to a keyframe so that it follows corrections of the map.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AnchoredPose {
    /// The keyframe made from this frame, if any. While the map holds it, its optimised pose replaces the tracked one.
    pub keyframe: Option<KeyframeId>,
    /// Keyframe relative to which the pose was measured.
    pub reference: KeyframeId,
    /// Camera pose in the reference keyframe.
    pub reference_from_camera: Se3,
    /// World pose at the time of measurement.
    pub online_world_from_camera: Se3,
}

impl AnchoredPose {
    /// World pose in this version of the map, or `None` if it holds neither keyframe. Culled keyframes resolve through
    /// their tombstones.
    #[must_use]
    pub fn world_from_camera_in(&self, view: &MapView) -> Option<Se3> {
        let own = self.keyframe.and_then(|id| view.world_from_keyframe(id));
        own.or_else(|| {
            let world_from_reference = view.world_from_keyframe(self.reference)?;
            Some(world_from_reference * self.reference_from_camera)
        })
    }

    /// World pose in this version of the map, or the pose at measurement time if it holds neither keyframe.
    #[must_use]
    pub fn best_world_from_camera(&self, view: &MapView) -> Se3 {
        let pose = self.world_from_camera_in(view);
        pose.unwrap_or(self.online_world_from_camera)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Arc;
    use stillpoint_geometry::Vec3;
    use stillpoint_map::Map;

    fn at(x: f64) -> Se3 {
        Se3 {
            translation: Vec3::new(x, 0.0, 0.0),
            ..Se3::identity()
        }
    }

    fn add(map: &mut Map, id: u32, parent: Option<u32>, x: f64) {
        let data = crate::synthetic::blank_keyframe(f64::from(id));
        let parent = parent.map(KeyframeId);
        assert!(map.insert_keyframe(KeyframeId(id), Arc::new(data), at(x), parent));
    }

    #[test]
    fn keyframe_frame_takes_its_pose_from_the_map() {
        let pose = |keyframe: Option<u32>| AnchoredPose {
            keyframe: keyframe.map(KeyframeId),
            reference: KeyframeId(0),
            reference_from_camera: at(0.5),
            online_world_from_camera: at(0.4),
        };
        let (plain, own) = (pose(None), pose(Some(5)));
        let mut map = Map::new(5, 1.45);
        assert_eq!(own.world_from_camera_in(map.view()), None);
        let x = |p: &AnchoredPose, map: &Map| p.best_world_from_camera(map.view()).translation.x;
        assert_eq!(x(&own, &map), 0.4);
        add(&mut map, 0, None, 1.0);
        assert_eq!([x(&plain, &map), x(&own, &map)], [1.5, 1.5]);
        // The mapper refined the keyframe's own pose.
        add(&mut map, 5, Some(0), 1.53);
        assert_eq!([x(&plain, &map), x(&own, &map)], [1.5, 1.53]);
    }
}

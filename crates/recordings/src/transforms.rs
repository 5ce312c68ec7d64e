//! Coordinate frames and the transforms between them, from `tf` messages.

use crate::budget::{LONGEST_NAME, MOST_TRANSFORMS};
use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, BTreeSet};
use stillpoint_geometry::nalgebra::{Matrix3, Quaternion, Rotation3, UnitQuaternion};
use stillpoint_geometry::{Se3, Vec3};
use stillpoint_ros_messages as ros;

/// Frames, with the first transform of each pair.
#[derive(Clone, Debug, Default)]
pub struct Transforms {
    /// `parent_from_child`, by child and parent, both ways.
    edges: BTreeMap<String, BTreeMap<String, Se3>>,
    /// Pairs of child and parent whose transform changes.
    moving: BTreeSet<(String, String)>,
    /// Number of stored pairs, and of transforms dropped beyond the limit.
    pairs: usize,
    beyond: u64,
}

/// A pair whose transforms differ by more than this (m, rad) is moving.
const STILL: f64 = 1e-4;

/// A pose; `None` for non-finite values or an invalid rotation.
pub(crate) fn pose(t: [f64; 3], q: &ros::Quaternion) -> Option<Se3> {
    let q = Quaternion::new(q.w, q.x, q.y, q.z);
    let norm = q.norm();
    let finite = t.iter().all(|v| v.is_finite()) && norm.is_finite();
    (finite && norm > 0.5 && norm < 2.0)
        .then(|| Se3::new(UnitQuaternion::new_normalize(q), Vec3::from(t)))
}

/// A transform message; `None` for non-finite values or an invalid rotation.
pub(crate) fn transform(rotation: Matrix3<f64>, t: [f64; 3]) -> Option<ros::Transform> {
    let finite = rotation.iter().chain(&t).all(|v| v.is_finite());
    if !finite || (rotation.determinant() - 1.0).abs() > 0.01 {
        return None;
    }
    let q = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix(&rotation));
    Some(ros::Transform {
        translation: ros::Vector3 {
            x: t[0],
            y: t[1],
            z: t[2],
        },
        rotation: ros::Quaternion {
            x: q.i,
            y: q.j,
            z: q.k,
            w: q.w,
        },
    })
}

/// Early versions of ROS 1 put a slash before frame names.
pub(crate) fn frame_name(name: &str) -> &str {
    name.trim_start_matches('/')
}

impl Transforms {
    /// Adds a transform; an invalid one, or one of a known pair, changes nothing.
    pub fn add(&mut self, transform: &ros::TransformStamped<'_>) {
        let t = &transform.transform.translation;
        let Some(pose) = pose([t.x, t.y, t.z], &transform.transform.rotation) else {
            return;
        };
        let parent = frame_name(&transform.header.frame_id).to_owned();
        let child = frame_name(&transform.child_frame_id).to_owned();
        let is_known = self
            .edges
            .get(&child)
            .is_some_and(|e| e.contains_key(&parent));
        if !is_known
            && (self.pairs >= MOST_TRANSFORMS || parent.len().max(child.len()) > LONGEST_NAME)
        {
            self.beyond += 1;
            return;
        }
        let known = self.edges.entry(child.clone()).or_default();
        // The first counts: later transforms of moving frames are of other times.
        match known.entry(parent.clone()) {
            Entry::Vacant(new) => {
                self.pairs += 1;
                new.insert(pose);
                let back = pose.inverse();
                self.edges.entry(parent).or_default().insert(child, back);
            }
            Entry::Occupied(first) => {
                let off = first.get().inverse() * pose;
                if off.translation.norm() > STILL || off.rotation.angle() > STILL {
                    self.moving.insert((child, parent));
                }
            }
        }
    }

    /// Number of transforms dropped beyond the limit of frame pairs.
    pub(crate) fn beyond(&self) -> u64 {
        self.beyond
    }

    pub(crate) fn reached_from(&self, frame: &str) -> BTreeSet<&str> {
        let mut seen = BTreeSet::new();
        let mut open: Vec<&str> = self
            .edges
            .get_key_value(frame_name(frame))
            .map(|(k, _)| k.as_str())
            .into_iter()
            .collect();
        while let Some(name) = open.pop() {
            if seen.insert(name) {
                open.extend(
                    self.edges
                        .get(name)
                        .into_iter()
                        .flatten()
                        .map(|(other, _)| other.as_str()),
                );
            }
        }
        seen
    }

    /// Whether a frame is part of any transform.
    #[must_use]
    pub fn knows(&self, frame: &str) -> bool {
        self.edges.contains_key(frame_name(frame))
    }

    /// `to_from_from`, along the shortest chain.
    #[must_use]
    pub fn find(&self, to: &str, from: &str) -> Option<Se3> {
        self.chain(to, from, &|_, _| true)
    }

    /// Like [`Self::find`], along static transforms only, and avoiding the frame `but_for`.
    #[must_use]
    pub fn find_fixed(&self, to: &str, from: &str, but_for: &str) -> Option<Se3> {
        let but_for = frame_name(but_for);
        self.chain(to, from, &|a, b| {
            let pair = |a: &str, b: &str| (a.to_owned(), b.to_owned());
            let moves = self.moving.contains(&pair(a, b)) || self.moving.contains(&pair(b, a));
            !moves && b != but_for
        })
    }

    fn chain(&self, to: &str, from: &str, allowed: &dyn Fn(&str, &str) -> bool) -> Option<Se3> {
        let (to, from) = (frame_name(to), frame_name(from));
        let mut seen = BTreeSet::from([from]);
        let mut open = vec![(from, Se3::identity())];
        while !open.is_empty() {
            let mut next = Vec::new();
            for (name, pose) in open {
                if name == to {
                    return Some(pose);
                }
                for (other, other_from_name) in self.edges.get(name).into_iter().flatten() {
                    if allowed(name, other) && seen.insert(other) {
                        next.push((other.as_str(), *other_from_name * pose));
                    }
                }
            }
            open = next;
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn edge(parent: &'static str, child: &'static str, x: f64) -> ros::TransformStamped<'static> {
        let mut t = ros::TransformStamped::default();
        t.header.frame_id = parent.into();
        t.child_frame_id = child.into();
        t.transform.translation.x = x;
        t.transform.rotation.w = 1.0;
        t
    }

    #[test]
    fn transform_chains_go_up_and_down() {
        let mut tree = Transforms::default();
        for (parent, child, x) in [
            ("base", "camera", 1.0),
            ("/camera", "colour", 0.25),
            ("camera", "/depth", 0.5),
            ("camera", "depth", 9.0),
            ("a", "b", 0.0),
        ] {
            tree.add(&edge(parent, child, x));
        }
        let found = tree.find("colour", "depth").unwrap();
        assert_eq!(found.translation, Vec3::new(0.25, 0.0, 0.0));
        let found = tree.find("base", "depth").unwrap();
        assert_eq!(found.translation, Vec3::new(1.5, 0.0, 0.0));
        assert!(tree.find("a", "depth").is_none());
        let mut broken = edge("camera", "b", f64::NAN);
        tree.add(&broken);
        broken.transform.translation.x = 0.0;
        broken.transform.rotation.w = 0.0;
        tree.add(&broken);
        assert!(tree.find("camera", "b").is_none());
    }
    #[test]
    fn moving_transforms_do_not_form_static_chains() {
        let mut tree = Transforms::default();
        for (parent, child, x) in [
            ("odom", "base", 0.0),
            ("odom", "base", 1.0),
            ("base", "mast", 0.5),
            ("base", "mast", 0.5),
            ("mast", "camera", 0.25),
            ("map", "odom", 0.0),
            ("map", "tag", 2.0),
        ] {
            tree.add(&edge(parent, child, x));
        }
        let fixed = |to: &str, from: &str, but_for: &str| {
            let pose = tree.find_fixed(to, from, but_for);
            pose.map(|p| p.translation.x)
        };
        assert_eq!(fixed("base", "camera", "odom"), Some(0.75));
        assert_eq!(fixed("/base", "/camera", "mast"), None);
        assert_eq!(fixed("odom", "camera", ""), None);
        assert_eq!(fixed("tag", "odom", "base"), Some(-2.0));
        assert_eq!(fixed("tag", "odom", "map"), None);
        assert!(tree.find("odom", "camera").is_some());
    }
}

//! Checks the map's invariants.

use crate::landmark::LandmarkSlot;
use crate::{KeyframeId, KeyframeSlot, LandmarkId, Map};
use std::cmp::Reverse;

/// A violated invariant.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Violation(pub String);

impl std::fmt::Display for Violation {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for Violation {}

impl Map {
    /// Checks all invariants, in linear time; meant for tests and debug builds.
    ///
    /// # Errors
    /// The first [`Violation`] found.
    pub fn check(&self) -> Result<(), Violation> {
        self.check_landmarks()?;
        self.check_keyframes()?;
        self.check_loops()
    }

    /// The slot of each landmark id, after checking that the tables are consistent and chains of merges end.
    fn checked_slots(&self) -> Result<Vec<LandmarkSlot<'_>>, Violation> {
        let bound = self.view.landmark_bound();
        let lengths = [self.observations.len(), self.view.merged.len()];
        ensure(lengths == [bound; 2], || {
            "one place for observations and for merges per landmark id".into()
        })?;
        let both = self
            .view
            .landmarks
            .iter()
            .find(|(i, _)| self.view.merged.get(*i).is_some());
        ensure(both.is_none(), || {
            format!(
                "landmark {} is live or merged, not both",
                both.map_or(0, |(i, _)| i)
            )
        })?;
        let ids = (0..bound as u32).map(LandmarkId::new);
        let slots: Vec<LandmarkSlot<'_>> = ids.map(|id| self.view.landmark_slot(id)).collect();
        let ends = ends_well(slots.len(), |i| match slots[i] {
            LandmarkSlot::Live(_) | LandmarkSlot::Culled => Step::End,
            LandmarkSlot::Merged(into) => Step::Next(into.index()),
        });
        if let Some(id) = ends.iter().position(|end| *end == NOWHERE) {
            ensure(false, || format!("merges of landmark {id} come to an end"))?;
        }
        Ok(slots)
    }

    fn check_landmarks(&self) -> Result<(), Violation> {
        let slots = self.checked_slots()?;
        let mut live = 0;
        for (i, slot) in slots.iter().enumerate() {
            let id = LandmarkId::new(i as u32);
            let list = self.observations(id);
            let LandmarkSlot::Live(l) = slot else {
                ensure(list.is_empty(), || {
                    format!("landmark {id} is gone and has no observations")
                })?;
                continue;
            };
            live += 1;
            ensure(!list.is_empty(), || format!("landmark {id} is observed"))?;
            ensure(list.windows(2).all(|w| w[0].0 < w[1].0), || {
                format!("observations of landmark {id} are sorted, one per keyframe")
            })?;
            ensure(l.observers as usize == list.len(), || {
                format!("landmark {id} counts its observers")
            })?;
            ensure(list.iter().any(|o| o.0 == l.anchor), || {
                format!("landmark {id} is observed by its anchor")
            })?;
            ensure(l.position_in_anchor.iter().all(|x| x.is_finite()), || {
                format!("landmark {id} has a finite position")
            })?;
            let anchor = self.view.keyframe(l.anchor).map(|k| k.submap);
            let mut with_depth = 0;
            for &(keyframe, feature) in list.iter() {
                let k = self.view.keyframe(keyframe);
                let back = k.and_then(|k| k.matches.get(feature as usize).copied().flatten());
                ensure(back == Some(id), || {
                    format!("keyframe {keyframe} knows that its feature {feature} observes {id}")
                })?;
                ensure(k.map(|k| k.submap) == anchor, || {
                    format!("keyframe {keyframe} is of the same submap as the anchor of {id}")
                })?;
                with_depth += k.map_or(0, |k| u32::from(k.data.depths[feature as usize] > 0.0));
            }
            ensure(l.depth_observers == with_depth, || {
                format!("landmark {id} counts its observers with depth")
            })?;
        }
        ensure(live == self.view.live_landmarks, || {
            "the view counts its live landmarks".into()
        })
    }

    /// The live keyframe that each id resolves to, or [`NOWHERE`].
    fn resolved(&self) -> Vec<u32> {
        ends_well(self.view.keyframes.len(), |i| {
            match self.view.keyframe_slot(KeyframeId(i as u32)) {
                KeyframeSlot::Live(_) => Step::End,
                KeyframeSlot::Culled { parent, .. } => Step::Next(parent.index()),
                KeyframeSlot::Empty => Step::Fall,
            }
        })
    }

    fn check_keyframes(&self) -> Result<(), Violation> {
        let resolves = self.resolved();
        let mut live = 0;
        for k in self.view.keyframes() {
            live += 1;
            ensure(k.matches.len() == k.data.len(), || {
                format!("keyframe {} has one match slot per feature", k.id)
            })?;
            ensure(k.world_from_camera.is_finite(), || {
                format!("keyframe {} has a finite pose", k.id)
            })?;
            for (feature, landmark) in k.matches.iter().enumerate() {
                let Some(landmark) = landmark else { continue };
                ensure(k.data.mappable[feature], || {
                    format!(
                        "feature {feature} of keyframe {} may observe {landmark}",
                        k.id
                    )
                })?;
                let known = self
                    .observations
                    .get(landmark.index())
                    .is_some_and(|list| list.binary_search(&(k.id, feature as u32)).is_ok());
                ensure(known, || {
                    format!(
                        "landmark {landmark} knows its observation in keyframe {}",
                        k.id
                    )
                })?;
            }
            let order = |c: &(KeyframeId, u32)| (Reverse(c.1), c.0);
            let sorted = k.covisible.windows(2).all(|w| order(&w[0]) < order(&w[1]));
            ensure(sorted, || {
                format!("covisible keyframes of {} are sorted", k.id)
            })?;
            for &(other, n) in &k.covisible {
                let at = (Reverse(n), k.id);
                let mutual = self
                    .view
                    .keyframe(other)
                    .is_some_and(|o| o.covisible.binary_search_by_key(&at, order).is_ok());
                ensure(mutual && other != k.id, || {
                    format!("covisibility of {} and {other} is mutual", k.id)
                })?;
                let submap = self.view.keyframe(other).map(|o| o.submap);
                ensure(submap == Some(k.submap), || {
                    format!("{} and {other} are of one submap", k.id)
                })?;
            }
            let parent_ok = |p: KeyframeId| {
                p != k.id && resolves.get(p.index()).is_some_and(|end| *end != NOWHERE)
            };
            ensure(k.parent.is_none_or(parent_ok), || {
                format!("the parent of keyframe {} can be resolved", k.id)
            })?;
            let submap_of = |p: KeyframeId| {
                let live = KeyframeId(*resolves.get(p.index())?);
                Some(self.view.keyframe(live)?.submap)
            };
            ensure(
                k.parent.is_none_or(|p| submap_of(p) == Some(k.submap)),
                || format!("keyframe {} is of the same submap as its parent", k.id),
            )?;
        }
        for (i, slot) in self.view.keyframes.iter() {
            let empty = matches!(slot, KeyframeSlot::Empty);
            ensure(!empty && resolves[i] != NOWHERE, || {
                format!("keyframe {i} has a pose, by itself or through its tombstone")
            })?;
        }
        ensure(live == self.view.live_keyframes, || {
            "the view counts its live keyframes".into()
        })
    }

    fn check_loops(&self) -> Result<(), Violation> {
        if self.view.loops.is_empty() {
            return Ok(());
        }
        // All at once: resolving each edge separately would follow the same chains of tombstones repeatedly.
        let resolves = self.resolved();
        let submap = |id: KeyframeId| {
            let live = KeyframeId(*resolves.get(id.index())?);
            Some(self.view.keyframe(live)?.submap)
        };
        for edge in self.view.loops() {
            let of_one = submap(edge.old).is_some() && submap(edge.old) == submap(edge.new);
            ensure(of_one && edge.is_sound(), || {
                format!(
                    "the loop from keyframe {} to {} was measured, and both are of one submap",
                    edge.old, edge.new
                )
            })?;
        }
        Ok(())
    }
}

fn ensure(holds: bool, invariant: impl FnOnce() -> String) -> Result<(), Violation> {
    if holds {
        Ok(())
    } else {
        Err(Violation(format!("does not hold: {}", invariant())))
    }
}

/// One step along a chain of tombstones or merges.
enum Step {
    End,
    Fall,
    Next(usize),
}

/// The end of the chain from each of `len` slots; [`NOWHERE`] for a cycle or a missing slot. Takes linear time and four
/// bytes per slot, since a malformed file may have long chains and many slots.
fn ends_well(len: usize, step: impl Fn(usize) -> Step) -> Vec<u32> {
    let (mut ends, mut seen) = (vec![NOWHERE; len], vec![false; len]);
    let mut path = Vec::new();
    for start in 0..len {
        let mut at = start;
        let end = loop {
            if at >= len {
                break NOWHERE;
            }
            // A slot seen on this path that has no result yet is part of a cycle.
            if seen[at] {
                break ends[at];
            }
            seen[at] = true;
            path.push(at);
            match step(at) {
                Step::End => break at as u32,
                Step::Fall => break NOWHERE,
                Step::Next(next) => at = next,
            }
        };
        for i in path.drain(..) {
            ends[i] = end;
        }
    }
    ends
}

const NOWHERE: u32 = u32::MAX;

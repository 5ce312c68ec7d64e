//! The map's invariants, in code.

use crate::{KeyframeId, LandmarkId, LandmarkSlot, Map};

/// An invariant that does not hold.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Violation(pub String);

impl std::fmt::Display for Violation {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for Violation {}

impl Map {
    /// Checks every invariant; meant for tests and debug builds, linear in the size of the map.
    ///
    /// # Errors
    /// The first [`Violation`] found.
    pub fn check(&self) -> Result<(), Violation> {
        self.check_landmarks()?;
        self.check_keyframes()
    }

    fn check_landmarks(&self) -> Result<(), Violation> {
        ensure(self.observations.len() == self.view.landmarks.len(), || {
            "one list of observations per landmark id".into()
        })?;
        let mut live = 0;
        for (i, slot) in self.view.landmarks.iter().enumerate() {
            let id = LandmarkId(i as u32);
            let list = &self.observations[i];
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
            let mut with_depth = 0;
            for &(keyframe, feature) in list {
                let k = self.view.keyframe(keyframe);
                let back = k.and_then(|k| k.matches.get(feature as usize).copied().flatten());
                ensure(back == Some(id), || {
                    format!("keyframe {keyframe} knows that its feature {feature} observes {id}")
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

    fn check_keyframes(&self) -> Result<(), Violation> {
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
            for &(other, n) in &k.covisible {
                let mutual = self
                    .view
                    .keyframe(other)
                    .is_some_and(|o| o.covisible.contains(&(k.id, n)));
                ensure(mutual && other != k.id, || {
                    format!("covisibility of {} and {other} is mutual", k.id)
                })?;
            }
            let parent_ok = |p: KeyframeId| p != k.id && self.view.resolve_keyframe(p).is_some();
            ensure(k.parent.is_none_or(parent_ok), || {
                format!("the parent of keyframe {} can be resolved", k.id)
            })?;
        }
        for (i, _) in self.view.keyframes.iter().enumerate() {
            let id = KeyframeId(i as u32);
            let empty = matches!(self.view.keyframe_slot(id), crate::KeyframeSlot::Empty);
            ensure(empty || self.view.world_from_keyframe(id).is_some(), || {
                format!("keyframe {id} has a pose, by itself or through its tombstone")
            })?;
        }
        ensure(live == self.view.live_keyframes, || {
            "the view counts its live keyframes".into()
        })
    }
}

fn ensure(holds: bool, invariant: impl FnOnce() -> String) -> Result<(), Violation> {
    if holds {
        Ok(())
    } else {
        Err(Violation(format!("does not hold: {}", invariant())))
    }
}

//! Two maps as one.

use crate::config::Config;
use crate::looping::LoopCloser;
use crate::mapping::Mapper;
use crate::messages::{LoopCloserMsg, MapperMsg};
use crate::report::LoopReport;
use std::collections::BTreeMap;
use std::sync::Arc;
use stillpoint_map::{AppendError, KeyframeId, Map, SubmapId};

/// What became of putting two maps together.
#[derive(Debug)]
pub struct JoinedMaps {
    /// Both maps, the second under new ids. In one frame of reference, that of the first, where places were recognised; else as
    /// submaps of which nobody knows how they lie to each other.
    pub map: Map,
    /// The places of the second that looked like places of the first.
    pub reports: Vec<LoopReport>,
    /// Submaps before, and submaps that are left.
    pub submaps: [usize; 2],
    /// What was added to the keyframe ids of the second: those of the first are below.
    pub added: u32,
}

impl JoinedMaps {
    /// How many submaps hold keyframes of both maps: none when nothing ties them.
    #[must_use]
    pub fn shared_submaps(&self) -> usize {
        let mut of: BTreeMap<SubmapId, [bool; 2]> = BTreeMap::new();
        for k in self.map.view().keyframes() {
            of.entry(k.submap).or_default()[usize::from(k.id.0 >= self.added)] = true;
        }
        of.values().filter(|both| **both == [true; 2]).count()
    }
}

/// Puts two maps together, as far as places of the second are recognised in the first: keyframe by keyframe, as if the camera
/// that made the second went through the first once more.
///
/// # Errors
/// [`AppendError`] when their features cannot be compared.
pub fn join_maps(config: &Config, mut base: Map, other: &Map) -> Result<JoinedMaps, AppendError> {
    let mut loop_closer = LoopCloser::new(config);
    loop_closer.step(LoopCloserMsg::Known {
        view: base.publish(),
    });
    let added = base.append(other)?;
    let mut mapper = Mapper::new(config).with_map(base);
    let mut view = mapper.publish();
    let before = view.submaps().len();
    let mut reports = Vec::new();
    let ids = view.keyframes().map(|k| k.id);
    let new: Vec<KeyframeId> = ids.filter(|id| id.0 >= added).collect();
    for id in new {
        let out = loop_closer.step(LoopCloserMsg::Keyframe {
            id,
            view: Arc::clone(&view),
        });
        reports.extend(out.report);
        if let Some(correction) = out.correction {
            let out = mapper.step(MapperMsg::Correct(correction));
            view = out.view;
            let map_version = view.version();
            loop_closer.step(LoopCloserMsg::Corrected { map_version });
        }
    }
    let submaps = [before, view.submaps().len()];
    Ok(JoinedMaps {
        map: mapper.into_map(),
        reports,
        submaps,
        added,
    })
}

//! `--things`: what stands in the room, gathered while frames go by.

use crate::failure::Failure;
use crate::sink::{Ended, Output, Sink, Start, Subscription};
use crate::things::to_json;
use clap::Args;
use std::sync::Arc;
use stillpoint::dense::{ThingMap, Things, ThingsConfig};
use stillpoint::imaging::FrameId;
use stillpoint::live::Watch;
use stillpoint::map::{Extension, MapView};
use stillpoint::slam::{Event, Subscriber};

/// What is asked for.
#[derive(Clone, Debug, Default, Args)]
pub(crate) struct ThingsOutput {
    /// Gather what stands in the room: chairs, tables, screens and whatever else the detector knows and stands still, people never. Writes
    /// things.json; --save-map keeps them in the map, for map objects. Needs a detector.
    #[arg(long, verbatim_doc_comment)]
    pub(crate) things: bool,
}

impl Output for ThingsOutput {
    /// Where it is not asked for, what an earlier run knew stays as it is.
    fn begin(&self, start: &mut Start<'_>) -> Result<Option<Box<dyn Sink>>, Failure> {
        let known = start.known.and_then(|k| k.things.clone());
        if !self.things {
            return Ok(known.map(|map| Box::new(KnownThings(Some(map))) as Box<dyn Sink>));
        }
        let mut settings = ThingsConfig::default();
        settings.about_up = start.up.map_or(settings.about_up, |up| up.vector());
        let weights = start.config.motion_weights.clone();
        let mut things = Things::new(&settings, &start.camera).with_weights(weights);
        if start.known.is_some() {
            things = things.with_first_keyframe(start.first_keyframe());
            things = things.starting_with(known.unwrap_or_default());
        }
        if let Some(frames) = start.logged.things.take() {
            things = things.with_frames(frames.into_iter().map(FrameId));
        }
        Ok(Some(Box::new(Gatherer(things))))
    }
}

/// Gathers while frames go by.
struct Gatherer(Things);

impl Sink for Gatherer {
    fn subscribe(&mut self, _: &Arc<MapView>, _: Option<&Watch>) -> Option<Subscription> {
        Some(Subscription::to_images("things", 1))
    }

    fn receive(&mut self, event: &Event) -> Result<(), Failure> {
        self.0.receive(event);
        Ok(())
    }

    /// What there is at the poses of the final map.
    fn settle(&mut self, ended: &mut Ended<'_>) -> Result<(), Failure> {
        let _span = tracing::info_span!("gather").entered();
        let map = self.0.at(&ended.session.view);
        let frames = self.0.taken().iter().map(|f| f.0).collect();
        ended.found.extensions.push(extension(&map));
        ended.found.shelf.put(Gathered { map, frames });
        Ok(())
    }

    fn finish(self: Box<Self>, ended: &mut Ended<'_>) -> Result<(), Failure> {
        match (&mut ended.folder, ended.found.shelf.get::<Gathered>()) {
            (Some(folder), Some(Gathered { map, .. })) => {
                let view = &ended.session.view;
                let json = to_json(&map.rooms(view), &map.list(view))?;
                folder.write("things.json", json.as_bytes())
            }
            _ => Ok(()),
        }
    }
}

/// What stands in the room.
pub(crate) struct Gathered {
    map: ThingMap,
    /// Numbers of the frames that were looked at.
    pub(crate) frames: Vec<u32>,
}

/// What an earlier run knew.
struct KnownThings(Option<ThingMap>);

impl Sink for KnownThings {
    fn settle(&mut self, ended: &mut Ended<'_>) -> Result<(), Failure> {
        let kept = self.0.take().map(|map| extension(&map));
        ended.found.extensions.extend(kept);
        Ok(())
    }

    fn finish(self: Box<Self>, _: &mut Ended<'_>) -> Result<(), Failure> {
        Ok(())
    }
}

/// What a map file keeps of it.
fn extension(map: &ThingMap) -> Extension {
    Extension {
        name: ThingMap::EXTENSION.to_owned(),
        bytes: map.to_bytes(),
    }
}

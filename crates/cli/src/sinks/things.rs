//! `--things`: maps the objects in the room during a run.

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

#[derive(Clone, Debug, Default, Args)]
pub(crate) struct ThingsOutput {
    /// Map the objects in the room: chairs, tables, screens and any other static object that the detector knows, never people. Writes
    /// things.json; --save-map stores them in the map, for map objects. Needs a detector.
    #[arg(long, verbatim_doc_comment)]
    pub(crate) things: bool,
}

impl Output for ThingsOutput {
    /// If not requested, the objects of the initial map are kept unchanged.
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

struct Gatherer(Things);

impl Sink for Gatherer {
    fn subscribe(&mut self, _: &Arc<MapView>, _: Option<&Watch>) -> Option<Subscription> {
        Some(Subscription::to_images("things", 1))
    }

    fn receive(&mut self, event: &Event) -> Result<(), Failure> {
        self.0.receive(event);
        Ok(())
    }

    /// Computes the objects at the poses of the final map.
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

pub(crate) struct Gathered {
    map: ThingMap,
    /// Numbers of the frames that were used.
    pub(crate) frames: Vec<u32>,
}

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

fn extension(map: &ThingMap) -> Extension {
    Extension {
        name: ThingMap::EXTENSION.to_owned(),
        bytes: map.to_bytes(),
    }
}

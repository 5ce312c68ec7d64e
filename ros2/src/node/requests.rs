//! Requests to the node.

use super::{Node, now};
use crate::maps;
use crate::run::Known;
use crate::services::{Answer, Ask};
use crate::value::Value;
use std::path::PathBuf;
use stillpoint::ros_messages as ros;
use stillpoint::ros_messages::{Format, to_bytes};
use stillpoint::slam::MapUse;

impl Node {
    pub(super) fn serve(&mut self) {
        let mut changed = Vec::new();
        let asked = self.services.poll(&mut self.parameters, &mut changed);
        self.tell_changes(&changed);
        for asked in asked {
            let answer = self.carry_out(asked.ask);
            match &answer {
                Ok(done) => self.voice.info(done),
                Err(why) => self.voice.error(why),
            }
            self.services.answer(&asked, &answer);
        }
    }

    fn tell_changes(&self, changed: &[(String, Value)]) {
        if changed.is_empty() {
            return;
        }
        let event = ros::ParameterEvent {
            stamp: now(),
            node: self.bus.node().full().into(),
            changed_parameters: changed
                .iter()
                .map(|(name, value)| ros::Parameter {
                    name: name.as_str().into(),
                    value: value.to_message(),
                })
                .collect(),
            ..ros::ParameterEvent::default()
        };
        self.parameter_events
            .send(&to_bytes(&event, Format::CdrLittleEndian));
        for (name, value) in changed {
            self.voice.info(&format!("{name} is {value}"));
        }
    }

    fn carry_out(&mut self, ask: Ask) -> Answer {
        match ask {
            Ask::Reset => {
                self.known = None;
                self.end_run(false);
                Ok("a new map begins with the next frame".to_owned())
            }
            Ask::SaveMap => {
                let run = self.run.as_ref().ok_or("there is no map yet")?;
                let map = run.watch().map().ok_or("mapping has ended by a fault")?;
                maps::save(&map, &self.map_file())
            }
            Ask::LoadMap => {
                let known = self.read_map(self.map_file())?;
                let keyframes = known.map.view().keyframe_count();
                self.end_run(true);
                self.known = Some(known);
                Ok(format!(
                    "{keyframes} keyframes; the camera is looked for in them"
                ))
            }
            Ask::LocalizeOnly(only) => self.localize_only(only),
            Ask::Pause(paused) => {
                self.paused = paused;
                Ok(if paused {
                    "frames go by until pause is called with false".to_owned()
                } else {
                    "frames are looked at".to_owned()
                })
            }
        }
    }

    fn localize_only(&mut self, only: bool) -> Answer {
        self.parameters.set("localize_only", &Value::Bool(only))?;
        let what = if only { "stays as it is" } else { "grows" };
        let Some(run) = &self.run else {
            return Ok(format!("the next map that is loaded {what}"));
        };
        let map = run.watch().map().ok_or("mapping has ended by a fault")?;
        if map.view().keyframe_count() == 0 {
            return Err("there is no map yet: nothing could be recognised in it".to_owned());
        }
        // A replay of the next run starts with this map, so it is saved to a file.
        let path = self.options.log.as_ref().map(|log| {
            let name = format!("{log}.{}.spmap", self.number + 1);
            PathBuf::from(name)
        });
        if let Some(path) = &path {
            maps::save(&map, path)?;
        }
        self.end_run(true);
        self.known = Some(Known {
            map,
            map_use: map_use(only),
            path,
            readout: None,
        });
        Ok(format!("the map {what}; the camera is looked for in it"))
    }

    fn map_file(&self) -> PathBuf {
        match self.parameters.get("map_file") {
            Some(Value::Text(file)) => file.into(),
            _ => PathBuf::new(),
        }
    }

    pub(super) fn read_map(&self, path: PathBuf) -> Result<Known, String> {
        let (map, readout) = maps::load(&path)?;
        let only = self.parameters.get("localize_only") == Some(&Value::Bool(true));
        Ok(Known {
            map,
            map_use: map_use(only),
            path: Some(path),
            readout,
        })
    }
}

fn map_use(only: bool) -> MapUse {
    if only { MapUse::Localize } else { MapUse::Grow }
}

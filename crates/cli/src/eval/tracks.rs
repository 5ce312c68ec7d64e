//! Reads tables of objects: `run --objects`, and `boxes.csv` beside recordings.

use crate::failure::Failure;
use std::collections::BTreeMap;
use std::path::Path;
use stillpoint::datasets::read_regular_text;
use stillpoint::evaluation::objects::{PointMotion, TrackedBox};
use stillpoint::geometry::Vec3;

/// Maximum size of a table, bytes: hours of crowds.
const LARGEST: u64 = 1 << 30;

/// A row of `run --objects`.
#[derive(Clone, Debug)]
pub(super) struct TrackRow {
    pub(super) stamp: f64,
    pub(super) class: String,
    /// Confirmed or coasting: neither tentative nor hidden.
    pub(super) confirmed: bool,
    pub(super) parked: bool,
    pub(super) thing: TrackedBox,
}

/// A row of `boxes.csv`.
#[derive(Clone, Debug)]
pub(super) struct BoxRow {
    pub(super) stamp: f64,
    pub(super) visible_px: f64,
    pub(super) thing: TrackedBox,
}

pub(super) fn read_tracks(path: &Path) -> Result<Vec<TrackRow>, Failure> {
    let text = read(path, "--objects TRACKS.csv")?;
    let table = Table::new(path, &text)?;
    let [id, class, state, motion] = ["id", "class", "state", "motion"].map(|n| table.column(n));
    let (id, class, state, motion) = (id?, class?, state?, motion?);
    let row = |(line, cells): &(usize, Vec<&str>)| {
        let (stamp, thing) = table.thing(*line, cells, id)?;
        Ok(TrackRow {
            stamp,
            thing,
            class: cells[class].to_owned(),
            confirmed: ["confirmed", "coasting"].contains(&cells[state]),
            parked: cells[motion] == "parked",
        })
    };
    table.rows.iter().map(row).collect()
}

/// Reads the rows of boxes in file order. `option` named the file, for messages.
pub(super) fn read_boxes(path: &Path, option: &str) -> Result<Vec<BoxRow>, Failure> {
    let text = read(path, option)?;
    let table = Table::new(path, &text)?;
    let ids = ["mover", "walker", "id"];
    let id = ids.iter().find_map(|n| table.names.get(n));
    let id = *id.ok_or_else(|| table.wrong(1, "a column mover, walker or id", "none"))?;
    let visible = table.names.get("visible_px");
    let row = |(line, cells): &(usize, Vec<&str>)| {
        let (stamp, thing) = table.thing(*line, cells, id)?;
        Ok(BoxRow {
            stamp,
            thing,
            visible_px: match visible {
                Some(&k) => table.number(*line, cells, k)?,
                None => f64::INFINITY,
            },
        })
    };
    table.rows.iter().map(row).collect()
}

fn read(path: &Path, option: &str) -> Result<String, Failure> {
    read_regular_text(path, LARGEST).map_err(|e| {
        Failure::input(format!(
            "{option}: expected a table at {}, found: {e}; check the path",
            path.display()
        ))
    })
}

struct Table<'a> {
    path: &'a Path,
    names: BTreeMap<&'a str, usize>,
    /// Line number, from 1, and cells of each row.
    rows: Vec<(usize, Vec<&'a str>)>,
}

impl<'a> Table<'a> {
    fn new(path: &'a Path, text: &'a str) -> Result<Self, Failure> {
        let mut lines = text.lines().enumerate();
        let header = lines.next().map_or("", |l| l.1);
        let names = header.split(',').enumerate();
        let mut table = Self {
            path,
            names: names.map(|(k, name)| (name.trim(), k)).collect(),
            rows: Vec::new(),
        };
        let width = header.split(',').count();
        for (n, line) in lines.filter(|l| !l.1.trim().is_empty()) {
            let cells: Vec<&str> = line.split(',').map(str::trim).collect();
            if cells.len() != width {
                let expected = format!("{width} columns as in the header");
                return Err(table.wrong(n + 1, &expected, &cells.len().to_string()));
            }
            table.rows.push((n + 1, cells));
        }
        Ok(table)
    }

    fn wrong(&self, line: usize, expected: &str, found: &str) -> Failure {
        Failure::input(format!(
            "{}:{line}: expected {expected}, found {}; use a table of run --objects, or the boxes.csv of a recording",
            self.path.display(),
            found.escape_default()
        ))
    }

    fn column(&self, name: &str) -> Result<usize, Failure> {
        let found = self.names.get(name).copied();
        found.ok_or_else(|| self.wrong(1, &format!("a column {name}"), "none"))
    }

    fn number(&self, line: usize, cells: &[&str], column: usize) -> Result<f64, Failure> {
        let number = cells[column].parse().ok().filter(|x: &f64| x.is_finite());
        number.ok_or_else(|| self.wrong(line, "a finite number", cells[column]))
    }

    /// Stamp, id, box and, where given, position and velocity.
    fn thing(&self, line: usize, cells: &[&str], id: usize) -> Result<(f64, TrackedBox), Failure> {
        let number = |name: &str| self.number(line, cells, self.column(name)?);
        let thing = TrackedBox {
            id: (cells[id].parse()).map_err(|_| self.wrong(line, "a whole number", cells[id]))?,
            bounds: [number("x0")?, number("y0")?, number("x1")?, number("y1")?],
            motion: self.motion(line, cells)?,
        };
        Ok((number("timestamp")?, thing))
    }

    fn motion(&self, line: usize, cells: &[&str]) -> Result<Option<PointMotion>, Failure> {
        let mut values = [0.0; 6];
        for (value, name) in values.iter_mut().zip(["px", "py", "pz", "vx", "vy", "vz"]) {
            match self.names.get(name) {
                Some(&k) if !cells[k].is_empty() => *value = self.number(line, cells, k)?,
                _ => return Ok(None),
            }
        }
        let [px, py, pz, vx, vy, vz] = values;
        Ok(Some(PointMotion {
            position: Vec3::new(px, py, pz),
            velocity: Vec3::new(vx, vy, vz),
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(text: &str) -> (tempfile::TempDir, std::path::PathBuf) {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("t.csv");
        std::fs::write(&path, text).unwrap();
        (dir, path)
    }

    #[test]
    fn columns_are_found_by_name() {
        let (_dir, path) =
            file("timestamp,walker,x0,y0,x1,y1,visible_px\n1.5,3,10,20,30,60,800\n\n");
        let rows = read_boxes(&path, "BOXES").unwrap();
        assert_eq!(
            (rows.len(), rows[0].stamp, rows[0].visible_px),
            (1, 1.5, 800.0)
        );
        assert_eq!((rows[0].thing.id, rows[0].thing.motion), (3, None));
        assert_eq!(rows[0].thing.bounds, [10.0, 20.0, 30.0, 60.0]);
        let (_dir, path) = file(
            "id,timestamp,class,state,motion,x0,y0,x1,y1,px,py,pz,vx,vy,vz\n\
             7,2,person,coasting,parked,1,2,3,4,1,2,3,0.5,0,0\n8,2,tv,tentative,unknown,1,2,3,4,,,,,,\n",
        );
        let rows = read_tracks(&path).unwrap();
        assert!(rows[0].confirmed && rows[0].parked && !rows[1].confirmed && !rows[1].parked);
        assert_eq!(
            rows[0].thing.motion.unwrap().velocity,
            Vec3::new(0.5, 0.0, 0.0)
        );
        assert_eq!((rows[1].class.as_str(), rows[1].thing.motion), ("tv", None));
    }

    #[test]
    fn malformed_rows_are_reported_with_their_line() {
        let header = "timestamp,mover,x0,y0,x1,y1,visible_px\n";
        for (text, part) in [
            (
                format!("{header}1,1,0,0,1,1,5\n1,1,0,0\n"),
                ":3: expected 7 columns",
            ),
            (
                format!("{header}1,1,0,0,nan,1,5\n"),
                ":2: expected a finite number, found nan",
            ),
            (
                format!("{header}1,-1,0,0,1,1,5\n"),
                ":2: expected a whole number",
            ),
            (
                "timestamp,x0\n1,2\n".to_owned(),
                ":1: expected a column mover",
            ),
            (String::new(), ":1: expected a column mover"),
        ] {
            let (_dir, path) = file(&text);
            let error = read_boxes(&path, "BOXES").unwrap_err().to_string();
            assert!(error.contains(part), "{error}");
        }
    }
}

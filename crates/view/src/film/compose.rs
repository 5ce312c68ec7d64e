//! Composes both halves of an image and the lines under them.

use super::camera::Viewpoint;
use super::legend::{Entry, draw_line, legend};
use super::solid::{Solid, Surface};
use crate::text::Text;
use crate::{Colour, Picture, shapes};
use stillpoint_geometry::{Se3, Vec3};

/// Width of an image, px: unscaled on a page of text.
const WIDTH: usize = 900;
pub(super) const GAP: usize = 4;
pub(super) const TEXT: f32 = 15.0;
/// Background of the right half and of the lines below.
const GROUND: Colour = Colour::PANEL;
/// Line width of a trajectory, and of the true one, which stays visible on both sides of one on top, px.
const LINE: f32 = 2.2;
const TRUE_LINE: f32 = 5.0;
/// Width of the dark edge around a trajectory, px, and its opacity.
const EDGE: f32 = 1.2;
const EDGE_SHARE: f32 = 0.55;
/// Poses farther apart than this, s, are not connected by a line.
const APART: f64 = 0.5;
const CAMERA: f64 = 26.0;
/// Maximum number of surface points for choosing the viewpoint.
const SAMPLES: usize = 4000;
/// Share of them, nearest to the trajectories, that must be visible: with all far walls visible, everything else would be small.
const NEAREST: f64 = 0.6;

/// A trajectory.
#[derive(Clone, Debug)]
pub struct Track {
    /// Name in the legend.
    pub name: String,
    /// Its error, for the legend; may be empty.
    pub note: String,
    /// Its colour.
    pub colour: Colour,
    /// Whether it is the ground truth, which is drawn wide below the others.
    pub is_truth: bool,
    /// Stamps, s, and positions, m, by time, in the surface's frame of reference.
    pub points: Vec<(f64, Vec3)>,
}

/// Contents of the right half.
#[derive(Clone, Copy, Debug)]
pub struct Plot<'a> {
    /// The surface.
    pub surface: Surface<'a>,
    /// Trajectories; the last one is drawn on top, and is the camera's.
    pub tracks: &'a [Track],
    /// Up direction.
    pub up: Vec3,
    /// Average viewing direction of the camera.
    pub heading: Vec3,
    /// Half width and half height of the camera's image at distance 1.
    pub opening: [f64; 2],
    /// Name of the trajectory error; may be empty.
    pub measure: &'a str,
    /// Playback speed relative to the recording.
    pub speed: f64,
}

/// State at one time.
#[derive(Clone, Copy, Debug)]
pub struct Stand<'a> {
    /// Image number, from 0.
    pub number: u32,
    /// Stamp, s.
    pub stamp: f64,
    /// Image of the left half.
    pub view: &'a Picture,
    /// The final pose, if any.
    pub pose: Option<&'a Se3>,
}

/// Draws images in time order.
pub struct Film<'a> {
    plot: Plot<'a>,
    viewpoint: Viewpoint,
    solid: Solid,
    size: (usize, usize),
    legend: Vec<Vec<Entry>>,
}

impl<'a> Film<'a> {
    /// Width of the left half, px.
    pub const VIEW: usize = (WIDTH - GAP) / 2;

    /// For halves of this height, px.
    #[must_use]
    pub fn new(plot: &Plot<'a>, height: usize) -> Self {
        let size = (Self::VIEW, height);
        let positions = plot.surface.positions;
        let every = positions.len().div_ceil(SAMPLES).max(1);
        let cut = positions.iter().step_by(every);
        let mut cut: Vec<Vec3> = cut.map(|p| Vec3::from(p.map(f64::from))).collect();
        let whole = plot.tracks.iter().flat_map(|t| &t.points);
        let whole: Vec<Vec3> = whole.map(|p| p.1).collect();
        let middle = whole.iter().sum::<Vec3>() / whole.len().max(1) as f64;
        cut.sort_by(|a, b| (a - middle).norm().total_cmp(&(b - middle).norm()));
        cut.truncate((NEAREST * cut.len() as f64).ceil() as usize);
        let viewpoint = Viewpoint::fitting(&cut, &whole, (&plot.up, &plot.heading), size);
        Self {
            solid: Solid::new(&plot.surface, &viewpoint, size, GROUND),
            viewpoint,
            legend: legend(plot),
            plot: *plot,
            size,
        }
    }

    /// The image of a state, which must not precede the last one.
    #[must_use]
    pub fn picture(&mut self, stand: &Stand<'_>) -> Picture {
        let mut right = self.solid.picture(&self.plot.surface, stand.number);
        // All edges first: otherwise they would cover a trajectory below.
        for edge in [true, false] {
            for track in self.plot.tracks {
                self.draw_track(&mut right, track, stand.stamp, edge);
            }
        }
        if let (Some(pose), Some(track)) = (stand.pose, self.plot.tracks.last()) {
            self.draw_camera(&mut right, pose, track.colour);
        }
        let text = Text::of(TEXT);
        let below = self.legend.len() * text.line() + text.space(0.3);
        let mut picture = Picture::new(WIDTH, self.size.1 + below, GROUND);
        picture.paste(stand.view, 0, 0);
        picture.paste(&right, Self::VIEW + GAP, 0);
        let mut y = self.size.1 + text.space(0.15);
        for line in &self.legend {
            draw_line(&mut picture, y, text, line);
            y += text.line();
        }
        picture
    }

    /// Draws a trajectory up to a time: its dark edge, or the line itself.
    fn draw_track(&self, picture: &mut Picture, track: &Track, until: f64, edge: bool) {
        let seen = track.points.partition_point(|(stamp, _)| *stamp <= until);
        let points = &track.points[..seen];
        let at = |p: &Vec3| {
            let (x, y, _) = self.viewpoint.project(p)?;
            Some((x as f32, y as f32))
        };
        let (colour, width, share) = if edge {
            (Colour::BLACK, track.width() + 2.0 * EDGE, EDGE_SHARE)
        } else {
            (track.colour, track.width(), 1.0)
        };
        for pair in points.windows(2).filter(|p| p[1].0 - p[0].0 <= APART) {
            if let (Some(a), Some(b)) = (at(&pair[0].1), at(&pair[1].1)) {
                shapes::segment(picture, a, b, (width, share), colour);
            }
        }
        let head = points.last().and_then(|p| at(&p.1));
        if let Some(head) = head.filter(|_| !track.is_truth && !edge) {
            shapes::disc(picture, head, LINE + EDGE, Colour::BLACK);
            shapes::disc(picture, head, LINE, track.colour);
        }
    }

    fn draw_camera(&self, picture: &mut Picture, pose: &Se3, colour: Colour) {
        let tip = &pose.translation;
        let Some((x, y, z)) = self.viewpoint.project(tip) else {
            return;
        };
        let length = CAMERA * z / self.viewpoint.focal();
        let [w, h] = self.plot.opening;
        let corner = |(sx, sy): (f64, f64)| {
            let p = Vec3::new(sx * w, sy * h, 1.0) * length;
            let (x, y, _) = self.viewpoint.project(&pose.transform(&p))?;
            Some((x as f32, y as f32))
        };
        let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(corner);
        let tip = (x as f32, y as f32);
        for (i, a) in corners.iter().enumerate() {
            let (Some(a), Some(b)) = (*a, corners[(i + 1) % 4]) else {
                continue;
            };
            shapes::segment(picture, tip, a, (1.4, 1.0), colour);
            shapes::segment(picture, a, b, (1.4, 1.0), colour);
        }
    }
}

impl Track {
    pub(super) fn width(&self) -> f32 {
        if self.is_truth { TRUE_LINE } else { LINE }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn track(name: &str, colour: Colour, y: f64) -> Track {
        Track {
            name: name.to_owned(),
            note: "1.0 mm".to_owned(),
            colour,
            is_truth: name == "truth",
            points: (0..40)
                .map(|i| (0.1 * f64::from(i), Vec3::new(0.1 * f64::from(i), y, 0.0)))
                .collect(),
        }
    }

    fn plot(tracks: &[Track]) -> Plot<'_> {
        Plot {
            surface: Surface {
                positions: &[],
                normals: &[],
                colours: &[],
                triangles: &[],
                since: &[],
            },
            tracks,
            up: -Vec3::y(),
            heading: Vec3::z(),
            opening: [0.5, 0.4],
            measure: "ATE",
            speed: 1.0,
        }
    }

    fn pixels(picture: &Picture, colour: Colour, columns: std::ops::Range<usize>) -> usize {
        let all = (0..336).flat_map(|y| columns.clone().map(move |x| (x, y)));
        all.filter(|(x, y)| picture.at(*x, *y) == Some(colour))
            .count()
    }

    #[test]
    fn trajectories_grow_over_time() {
        let far = Colour::RIGID;
        let tracks = [
            track("truth", Colour::WHITE, 0.1),
            track("carried away", far, -0.6),
            track("Stillpoint", Colour::STATIC, 0.0),
        ];
        let plot = plot(&tracks);
        let mut film = Film::new(&plot, 336);
        let left = Picture::new(Film::VIEW, 336, Colour::SEMANTIC);
        let mut at = |stamp: f64, number| {
            let pose = Se3::identity();
            film.picture(&Stand {
                number,
                stamp,
                view: &left,
                pose: Some(&pose),
            })
        };
        let (early, late) = (at(1.0, 0), at(3.95, 1));
        assert_eq!(early.width(), WIDTH);
        assert!(early.height() > 336 && early.height() < 400);
        assert_eq!(
            pixels(&late, Colour::SEMANTIC, 0..Film::VIEW),
            336 * Film::VIEW
        );
        let right = Film::VIEW + GAP..WIDTH;
        for colour in [Colour::WHITE, far, Colour::STATIC] {
            let [few, many] = [&early, &late].map(|p| pixels(p, colour, right.clone()));
            assert!(few > 10 && many > 2 * few, "{colour:?}: {few} {many}");
        }
    }

    #[test]
    fn long_legend_takes_more_lines() {
        let lines = |n: usize| {
            let name = |i: usize| format!("system {i}");
            let tracks: Vec<Track> = (0..n)
                .map(|i| track(&name(i), Colour::of_number(i as u32), 0.0))
                .collect();
            let lines = legend(&plot(&tracks));
            let entries = lines.iter().flatten().filter(|e| !e.is_break()).count();
            assert_eq!(entries, 3 + 1 + n);
            lines.len()
        };
        assert_eq!((lines(1), lines(2), lines(4)), (1, 1, 2));
    }
}

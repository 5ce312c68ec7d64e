//! Runs one kernel repeatedly on simulated images of 640x480, for external counting of instructions as in `tools/arm/count.sh`.
//!
//! Preparation is independent of the number of repetitions, so the difference of two runs is the kernel alone. Prints a digest of the
//! results. A separate run renders the images, which takes longer than the kernels.

use crate::Failure;
use crate::experiments::shared::scene;
use std::hint::black_box;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use stillpoint::dense::{DenseConfig, Fuser};
use stillpoint::features::{
    Features, Flow, FlowConfig, OrbConfig, OrbExtractor,
    kernels::{Stages, distances},
};
use stillpoint::geometry::{Camera, Se3, nalgebra::Matrix4};
use stillpoint::imaging::{
    ColourImage, DepthImage, FrameId, Pyramid, RgbdFrame, Simd, kernels::gray,
};
use stillpoint::place::Vocabulary;
use stillpoint::simulator::SimulatorConfig;
use stillpoint::slam::{Config, System};

/// Runs one kernel repeatedly, for external counting of instructions
#[derive(clap::Args)]
pub(crate) struct Arguments {
    folder: PathBuf,
    /// Only render the images
    #[arg(long)]
    render: bool,
    #[arg(value_enum, required_unless_present = "render")]
    kernel: Option<Kernel>,
    /// Without SIMD
    #[arg(long)]
    scalar: bool,
    #[arg(long, default_value_t = 1)]
    times: usize,
}

#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum Kernel {
    Gray,
    Scale,
    Smooth,
    Corners,
    Orientation,
    Descriptors,
    Extract,
    Flow,
    Distances,
    Words,
    /// Fusion into a surface
    Fuse,
    /// Tracking and mapping of this many frames of a walk, at most 24
    Frame,
}

const FRAMES: usize = 24;
/// Bytes of a file before its images.
const HEAD: usize = 8 * 17;
/// Features per level, the extractor's quotas.
const QUOTAS: [usize; 5] = [537, 256, 122, 58, 27];

struct Task {
    simd: Simd,
    times: usize,
    folder: PathBuf,
    camera: Camera,
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let Some(kernel) = arguments.kernel.filter(|_| !arguments.render) else {
        return render(&arguments.folder);
    };
    let simd = match arguments.scalar {
        true => Simd::Scalar,
        false => Simd::detect(),
    };
    let task = Task {
        simd,
        times: arguments.times,
        folder: arguments.folder.clone(),
        camera: SimulatorConfig::default().camera,
    };
    let found = match kernel {
        Kernel::Gray => task.gray()?,
        Kernel::Scale => task.pyramid(false)?,
        Kernel::Smooth => task.pyramid(true)?,
        Kernel::Corners | Kernel::Orientation | Kernel::Descriptors => task.stages(kernel)?,
        Kernel::Extract => task.extract()?,
        Kernel::Flow => task.flow()?,
        Kernel::Distances => task.descriptors(false)?,
        Kernel::Words => task.descriptors(true)?,
        Kernel::Fuse => task.fuse()?,
        Kernel::Frame => task.frames()?,
    };
    println!("{kernel:?} {simd:?}: {found}");
    Ok(ExitCode::SUCCESS)
}

/// Writes each frame to a file: stamp and pose of its depth, depths, colours.
fn render(folder: &Path) -> Result<ExitCode, Failure> {
    let simulator = scene("walking_xyz", 0, Some(FRAMES))?;
    std::fs::create_dir_all(folder)?;
    for index in 0..FRAMES {
        let stamp = simulator.depth_stamp(index);
        let pose = simulator.world_from_camera(stamp).to_matrix();
        let numbers = [stamp].into_iter().chain(pose.iter().copied());
        let mut bytes: Vec<u8> = numbers.flat_map(f64::to_le_bytes).collect();
        let depth = simulator.depth(index);
        bytes.extend(depth.data().iter().flat_map(|z| z.to_le_bytes()));
        bytes.extend(simulator.colour(index).data());
        std::fs::write(folder.join(index.to_string()), bytes)?;
    }
    Ok(ExitCode::SUCCESS)
}

impl Task {
    /// Reads a frame written by [`render`], with its pose.
    fn posed(&self, index: usize) -> Result<(RgbdFrame, Se3), Failure> {
        let bytes = std::fs::read(self.folder.join(index.to_string()))?;
        let (width, height) = (self.camera.width as usize, self.camera.height as usize);
        let pixels = width * height;
        if bytes.len() != HEAD + 7 * pixels {
            return Err("expected images of `--render`, found a file of another size".into());
        }
        let (head, images) = bytes.split_at(HEAD);
        let (depths, colours) = images.split_at(4 * pixels);
        let numbers: Vec<f64> = head
            .chunks_exact(8)
            .filter_map(|b| Some(f64::from_le_bytes(b.try_into().ok()?)))
            .collect();
        let pose = Matrix4::from_column_slice(&numbers[1..]);
        let pose = Se3::from_matrix(
            &pose.fixed_view::<3, 3>(0, 0).into(),
            pose.fixed_view::<3, 1>(0, 3).into(),
        );
        let metres = depths.chunks_exact(4);
        let metres = metres.map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]));
        let colour = ColourImage::from_vec(width, height, colours.to_vec())?;
        let frame = RgbdFrame {
            id: FrameId(index as u32),
            stamp: numbers[0],
            depth_stamp: numbers[0],
            gray: colour.to_gray(),
            colour: Some(Arc::new(colour)),
            depth: DepthImage::from_vec(width, height, metres.collect())?,
        };
        Ok((frame, pose))
    }

    fn frame(&self, index: usize) -> Result<RgbdFrame, Failure> {
        Ok(self.posed(index)?.0)
    }

    /// Returns the last result.
    fn repeat(&self, mut step: impl FnMut() -> u64) -> u64 {
        (0..self.times).fold(0, |_, _| step())
    }

    fn gray(&self) -> Result<u64, Failure> {
        let frame = self.frame(0)?;
        let (colour, mut out) = (frame.colour.ok_or("no colours")?, frame.gray);
        Ok(self.repeat(|| {
            gray(black_box(&colour), &mut out, self.simd);
            out.data()[99].into()
        }))
    }

    /// Builds or smooths a pyramid of five levels.
    fn pyramid(&self, smooth: bool) -> Result<u64, Failure> {
        let image = self.frame(0)?.gray;
        let mut pyramid = Pyramid::new(5, 1.45, self.simd);
        pyramid.build(&image);
        Ok(self.repeat(|| {
            if smooth {
                pyramid.smooth_all();
            } else {
                pyramid.build(black_box(&image));
            }
            pyramid.level(4).data()[99].into()
        }))
    }

    /// A stage of feature extraction, on five levels.
    fn stages(&self, kernel: Kernel) -> Result<u64, Failure> {
        let mut pyramid = Pyramid::new(5, 1.45, self.simd);
        pyramid.build(&self.frame(0)?.gray);
        pyramid.smooth_all();
        let mut stages = vec![Stages::new(self.simd); 5];
        for (level, stages) in stages.iter_mut().enumerate() {
            stages.fast(pyramid.level(level));
            stages.spread(pyramid.level(level), QUOTAS[level]);
        }
        Ok(self.repeat(|| {
            let each = stages.iter_mut().enumerate().map(|(level, stages)| {
                let (image, smooth) = (pyramid.level(level), pyramid.smooth(level));
                match kernel {
                    Kernel::Corners => stages.fast(image) as u64,
                    Kernel::Orientation => stages.orient(image).to_bits().into(),
                    _ => stages.describe(smooth).0[0] & 0xffff_ffff,
                }
            });
            each.sum()
        }))
    }

    fn extract(&self) -> Result<u64, Failure> {
        let image = self.frame(0)?.gray;
        let mut extractor = OrbExtractor::new(&OrbConfig::default(), self.simd);
        let mut features = Features::default();
        Ok(self.repeat(|| {
            extractor.extract(black_box(&image), &mut features);
            features.len() as u64
        }))
    }

    /// Flow from one frame to the next, and back.
    fn flow(&self) -> Result<u64, Failure> {
        let mut extractor = OrbExtractor::new(&OrbConfig::default(), self.simd);
        let (mut features, mut second) = <(Features, Features)>::default();
        extractor.extract(&self.frame(0)?.gray, &mut features);
        extractor.extract(&self.frame(1)?.gray, &mut second);
        let (previous, current) = (extractor.previous_pyramid(), extractor.pyramid());
        let points: Vec<_> = features.keypoints.iter().map(|k| [k.x, k.y]).collect();
        let mut flow = Flow::new(FlowConfig::default(), self.simd);
        let mut out = Vec::new();
        Ok(self.repeat(|| {
            flow.track(previous, current, &points, None, &mut out);
            out.iter().flatten().count() as u64
        }))
    }

    /// Distances of all pairs of descriptors, or visual words of all.
    fn descriptors(&self, words: bool) -> Result<u64, Failure> {
        let mut features = Features::default();
        OrbExtractor::new(&OrbConfig::default(), self.simd)
            .extract(&self.frame(0)?.gray, &mut features);
        let vocabulary = Vocabulary::embedded();
        let all = &features.descriptors;
        Ok(self.repeat(|| {
            if words {
                let words = vocabulary.words(black_box(all));
                words.into_iter().map(u64::from).sum()
            } else {
                distances(black_box(all), self.simd).into()
            }
        }))
    }

    /// Fuses frames at true poses, after two that are already in the map.
    fn fuse(&self) -> Result<u64, Failure> {
        let mut fuser = Fuser::new(&DenseConfig::default(), &self.camera, self.simd)?;
        for index in [0, 3] {
            let (frame, pose) = self.posed(index)?;
            fuser.add(&frame, &[], &pose);
        }
        let (third, pose) = self.posed(6)?;
        for _ in 0..self.times {
            fuser.add(&third, &[], &pose);
        }
        Ok(digest(fuser.map().to_bytes().into_iter().map(u64::from)))
    }

    fn frames(&self) -> Result<u64, Failure> {
        let frames: Vec<RgbdFrame> = (0..FRAMES)
            .map(|i| self.frame(i))
            .collect::<Result<_, _>>()?;
        let mut system = System::new(Config::default(), self.camera, self.simd)?;
        for frame in frames.into_iter().take(self.times) {
            system.step(frame);
        }
        let poses = system.corrected_trajectory();
        let numbers = poses.iter().flat_map(|(_, pose)| {
            let matrix = pose.to_matrix();
            matrix.iter().map(|v| v.to_bits()).collect::<Vec<_>>()
        });
        Ok(digest(numbers))
    }
}

/// FNV.
fn digest(numbers: impl Iterator<Item = u64>) -> u64 {
    numbers.fold(0xcbf2_9ce4_8422_2325, |hash, number| {
        (hash ^ number).wrapping_mul(0x100_0000_01b3)
    })
}

//! A network as a `Detector`: an image in, boxes of COCO's classes out.

use crate::card::{Head, ModelCard};
use crate::error::ModelError;
use crate::heads::{self, Candidate, Mismatch};
use crate::interface::Interface;
use crate::letterbox::{Letterbox, Placement};
use crate::loading::{self, Failure, Loaded, look};
use crate::network::Network;
use crate::runtime::Runtime;
use crate::size::{InputSize, Size, fitted};
use serde::{Deserialize, Serialize};
use stillpoint_detection::{
    BoundingBox, ClassId, DetectError, Detection, Detections, Detector, DetectorInfo, DetectorKind,
};
use stillpoint_files::sha256_hex;
use stillpoint_imaging::{ColourImage, FrameId, RgbdFrame};

/// How a network is run and its output decoded.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct OnnxOptions {
    /// Minimum score (objectness times class) of a detection. Range: over 0 to 1. 0.25: lower ones are mostly wrong, and tracks bridge
    /// missed ones.
    pub score_threshold: f32,
    /// Intersection over union above which the weaker of two boxes of a class is dropped. Range: 0 to 1. 0.45: YOLOX's own. Not applied to
    /// networks with built-in suppression.
    pub iou_threshold: f32,
    /// Threads of the network. Range: 1 to 64. 1: the other cores belong to tracking and mapping.
    pub threads: usize,
    /// Size of the input. Fit: padding a 4:3 image to a square costs a quarter of the work.
    pub input: InputSize,
}

impl Default for OnnxOptions {
    fn default() -> Self {
        Self {
            score_threshold: 0.25,
            iou_threshold: 0.45,
            threads: 1,
            input: InputSize::default(),
        }
    }
}

/// A network that detects objects of COCO's classes.
pub struct OnnxDetector {
    name: String,
    sha256: String,
    options: OnnxOptions,
    card: ModelCard,
    network: Network,
    letterbox: Letterbox,
    own: Size,
    size: Size,
    /// Input sizes that were tried, with the error of those that failed. Only the last ones, so that images of many sizes do not fill the
    /// memory.
    tried: Vec<(Size, Option<String>)>,
}

const MOST_TRIED: usize = 64;

impl OnnxDetector {
    /// Loads a known model from its file's bytes, in `rten`. Errors and summaries refer to it by `name`. The model is run once on a blank
    /// image, so that mismatches are refused here and not at the first frame.
    ///
    /// # Errors
    /// [`ModelError`] for options out of range, and for models that do not load, do not run or are not known.
    pub fn from_bytes(
        bytes: Vec<u8>,
        name: &str,
        options: &OnnxOptions,
    ) -> Result<Self, ModelError> {
        Self::with_card(bytes, name, None, &Runtime::default(), options)
    }

    /// Loads a model from its file's bytes, with its card if it has one, in this runtime. See [`Self::from_bytes`].
    ///
    /// # Errors
    /// [`ModelError`] for options out of range, and for models that do not load, do not run, contradict their card, or are not known and
    /// have no card.
    pub fn with_card(
        bytes: Vec<u8>,
        name: &str,
        card: Option<&ModelCard>,
        runtime: &Runtime,
        options: &OnnxOptions,
    ) -> Result<Self, ModelError> {
        check_options(options)?;
        let sha256 = sha256_hex(&bytes);
        let Loaded {
            network,
            card,
            own,
            size,
        } = loading::load(bytes, name, card, runtime, options)?;
        Ok(Self {
            name: name.to_owned(),
            sha256,
            options: *options,
            card,
            network,
            letterbox: Letterbox::default(),
            own,
            size,
            tried: Vec::new(),
        })
    }

    /// The given card, or the recognised built-in one.
    #[must_use]
    pub fn card(&self) -> &ModelCard {
        &self.card
    }

    /// The model's inputs and outputs, as declared in its file.
    #[must_use]
    pub fn interface(&self) -> &Interface {
        self.network.interface()
    }

    /// Width and height of the network's input for the last image, px; before the first one, of the trial.
    #[must_use]
    pub fn input_size(&self) -> (usize, usize) {
        (self.size.width, self.size.height)
    }

    /// The boxes in one colour image, in raw pixels and within the image, best score first. Errors name `frame`. The first image of another
    /// aspect takes longer, since the network is prepared for it.
    ///
    /// # Errors
    /// [`DetectError::ImageSize`] for an image without pixels, and failures of the network.
    pub fn detect_image(
        &mut self,
        image: &ColourImage,
        frame: FrameId,
    ) -> Result<Vec<Detection>, DetectError> {
        let (width, height) = (image.width(), image.height());
        if width == 0 || height == 0 {
            return Err(DetectError::ImageSize {
                frame,
                expected: (width.max(1), height.max(1)),
                found: (width, height),
            });
        }
        let size = self.size_for(width, height);
        let boxes = match self.look(image, size) {
            // An image must not affect the next one.
            Err(_) if size != self.own && self.options.input == InputSize::Fit => {
                self.network.forget(size);
                self.look(image, self.own)
            }
            result => result,
        };
        boxes.map_err(|failure| match failure {
            Failure::Runtime(reason) => DetectError::Runtime { frame, reason },
            Failure::Output(Mismatch { expected, found }) => DetectError::Output {
                frame,
                expected,
                found,
            },
        })
    }

    fn size_for(&mut self, width: usize, height: usize) -> Size {
        // For a network that decodes its boxes itself, the output does not show whether they are right for another size.
        let baked = match self.card.head {
            Head::EndToEnd => self.network.own.is_some(),
            // Positions of its queries may be part of the graph, and training uses squares.
            Head::Detr => true,
            _ => false,
        };
        match self.options.input {
            InputSize::Fixed { width, height } => Size { width, height },
            InputSize::Fit if !baked => {
                let size = fitted(self.own, width, height, self.card.alignment());
                if self.allows(size) { size } else { self.own }
            }
            InputSize::Fit | InputSize::Model => self.own,
        }
    }

    /// Whether the graph allows a size: tried on a blank image, so that the result depends on the size alone.
    fn allows(&mut self, size: Size) -> bool {
        if size == self.own {
            return true;
        }
        if let Some((_, wrong)) = self.tried.iter().find(|(tried, _)| *tried == size) {
            return wrong.is_none();
        }
        let wrong = loading::attempt(&mut self.network, &self.card, size).err();
        if wrong.is_some() {
            self.network.forget(size);
        }
        let allowed = wrong.is_none();
        if self.tried.len() == MOST_TRIED {
            self.tried.remove(0);
        }
        self.tried.push((size, wrong.map(|w| w.to_string())));
        allowed
    }

    /// Runs the network on an image at this input size.
    fn look(&mut self, image: &ColourImage, size: Size) -> Result<Vec<Detection>, Failure> {
        self.size = size;
        let planes = {
            let _span = tracing::info_span!("letterbox").entered();
            self.letterbox.fill(image, &self.card.input, size)
        };
        let threshold = self.options.score_threshold;
        let mut boxes = look(&mut self.network, &self.card, planes, size, threshold)?;
        // Several classes of the network may map to one here, and ignored ones must not suppress others.
        boxes.retain_mut(|b| match self.card.class(b.class) {
            Some(class) => {
                b.class = usize::from(class.0);
                true
            }
            None => false,
        });
        let boxes = if matches!(self.card.head, Head::EndToEnd | Head::Detr) {
            heads::sorted(&boxes)
        } else {
            heads::suppress(&boxes, self.options.iou_threshold)
        };
        let placement = self.letterbox.placement();
        let found = boxes.iter().filter_map(|b| detection(b, placement, image));
        Ok(found.collect())
    }
}

/// The detection of a box, in image coordinates; its class is one of COCO's. `None` for boxes entirely in the padding.
fn detection(
    found: &Candidate,
    Placement { offset, scale }: Placement,
    image: &ColourImage,
) -> Option<Detection> {
    // The network measures from the corner of the first pixel, half a pixel before its centre.
    let x = |x: f64| (x - offset[0] as f64) * scale[0] - 0.5;
    let y = |y: f64| (y - offset[1] as f64) * scale[1] - 0.5;
    let BoundingBox { x0, y0, x1, y1 } = found.bounds;
    let bounds = BoundingBox {
        x0: x(x0),
        y0: y(y0),
        x1: x(x1),
        y1: y(y1),
    }
    .clipped(image.width(), image.height());
    (bounds.area() > 0.0).then_some(Detection {
        class: ClassId(u8::try_from(found.class).ok()?),
        score: found.score,
        bounds,
    })
}

impl Detector for OnnxDetector {
    fn detect(&mut self, frame: &RgbdFrame) -> Result<Detections, DetectError> {
        let Some(colour) = frame.colour.clone() else {
            return Err(DetectError::NoColour { frame: frame.id });
        };
        let expected = (frame.gray.width(), frame.gray.height());
        let found = (colour.width(), colour.height());
        if expected != found {
            return Err(DetectError::ImageSize {
                frame: frame.id,
                expected,
                found,
            });
        }
        Ok(Detections {
            frame: frame.id,
            stamp: frame.stamp,
            items: self.detect_image(&colour, frame.id)?,
        })
    }

    fn info(&self) -> DetectorInfo {
        DetectorInfo {
            sha256: Some(self.sha256.clone()),
            runtime: self.network.runtime().map(str::to_owned),
            head: Some(self.card.head.name().to_owned()),
            input: Some(self.input_size()),
            threads: Some(self.options.threads),
            ..DetectorInfo::new(DetectorKind::Onnx, &self.name)
        }
    }

    fn remark(&self) -> Option<String> {
        let mut wrong = self
            .tried
            .iter()
            .filter_map(|(size, wrong)| Some((size, wrong.as_ref()?)));
        let (size, reason) = wrong.next()?;
        let more = match wrong.count() {
            0 => String::new(),
            more => format!("; {more} more sizes failed"),
        };
        Some(format!(
            "{}: the network is run at its own {} px, with padding, where its graph does not allow the size that fits an image (at {size} px it gave: {reason}{more})",
            self.name, self.own
        ))
    }
}

impl std::fmt::Debug for OnnxDetector {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("OnnxDetector")
            .field("name", &self.name)
            .field("sha256", &self.sha256)
            .field("options", &self.options)
            .finish_non_exhaustive()
    }
}

fn check_options(options: &OnnxOptions) -> Result<(), ModelError> {
    let refuse = |option, expected, found| {
        Err(ModelError::Option {
            option,
            expected,
            found,
        })
    };
    let OnnxOptions {
        score_threshold,
        iou_threshold,
        threads,
        input: _,
    } = *options;
    if !(score_threshold > 0.0 && score_threshold <= 1.0) {
        return refuse(
            "score_threshold",
            "a share over 0 and up to 1",
            score_threshold.to_string(),
        );
    }
    if !(0.0..=1.0).contains(&iou_threshold) {
        return refuse(
            "iou_threshold",
            "a share from 0 to 1",
            iou_threshold.to_string(),
        );
    }
    if !(1..=64).contains(&threads) {
        return refuse("threads", "1 to 64 threads", threads.to_string());
    }
    Ok(())
}

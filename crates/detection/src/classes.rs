//! Names of the 80 classes of COCO.

use crate::ClassId;

/// Class names by number (Lin et al., "Microsoft COCO: Common Objects in Context", 2014; the 80 that are annotated with
/// boxes).
const NAMES: [&str; ClassId::COUNT] = [
    "person",
    "bicycle",
    "car",
    "motorcycle",
    "airplane",
    "bus",
    "train",
    "truck",
    "boat",
    "traffic light",
    "fire hydrant",
    "stop sign",
    "parking meter",
    "bench",
    "bird",
    "cat",
    "dog",
    "horse",
    "sheep",
    "cow",
    "elephant",
    "bear",
    "zebra",
    "giraffe",
    "backpack",
    "umbrella",
    "handbag",
    "tie",
    "suitcase",
    "frisbee",
    "skis",
    "snowboard",
    "sports ball",
    "kite",
    "baseball bat",
    "baseball glove",
    "skateboard",
    "surfboard",
    "tennis racket",
    "bottle",
    "wine glass",
    "cup",
    "fork",
    "knife",
    "spoon",
    "bowl",
    "banana",
    "apple",
    "sandwich",
    "orange",
    "broccoli",
    "carrot",
    "hot dog",
    "pizza",
    "donut",
    "cake",
    "chair",
    "couch",
    "potted plant",
    "bed",
    "dining table",
    "toilet",
    "tv",
    "laptop",
    "mouse",
    "remote",
    "keyboard",
    "cell phone",
    "microwave",
    "oven",
    "toaster",
    "sink",
    "refrigerator",
    "book",
    "clock",
    "vase",
    "scissors",
    "teddy bear",
    "hair drier",
    "toothbrush",
];

impl ClassId {
    /// Number of classes.
    pub const COUNT: usize = 80;

    /// All classes in ascending order.
    pub fn all() -> impl Iterator<Item = Self> {
        (0..Self::COUNT as u8).map(Self)
    }

    /// The name, e.g. `dining table`; `unknown` for an invalid number.
    #[must_use]
    pub fn name(self) -> &'static str {
        NAMES.get(usize::from(self.0)).copied().unwrap_or("unknown")
    }

    /// The class with a name. Case is ignored, and `_` or `-` may replace a blank, as in some tools.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        let name = normal(name);
        Self::all().find(|class| class.name() == name)
    }

    /// The class with the most similar name, at most two edits away.
    #[must_use]
    pub fn nearest(name: &str) -> Option<Self> {
        let name = normal(name);
        let distance = |class: &Self| edits(class.name(), &name);
        let best = Self::all().min_by_key(distance)?;
        (distance(&best) <= 2).then_some(best)
    }
}

impl std::fmt::Display for ClassId {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}

fn normal(name: &str) -> String {
    name.trim().to_ascii_lowercase().replace(['_', '-'], " ")
}

/// Levenshtein distance: the minimum number of insertions, deletions and replacements between two texts.
fn edits(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.chars().enumerate() {
        let mut diagonal = std::mem::replace(&mut row[0], i + 1);
        for (j, &y) in b.iter().enumerate() {
            let replaced = diagonal + usize::from(x != y);
            diagonal = row[j + 1];
            row[j + 1] = replaced.min(row[j] + 1).min(diagonal + 1);
        }
    }
    row[b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn class_names_and_ids_agree() {
        for (number, name) in [
            (0, "person"),
            (16, "dog"),
            (56, "chair"),
            (60, "dining table"),
            (79, "toothbrush"),
        ] {
            assert_eq!(ClassId(number).name(), name);
        }
        for class in ClassId::all() {
            assert_eq!(ClassId::from_name(class.name()), Some(class), "{class}");
        }
        assert_eq!(ClassId::from_name("Dining_Table"), Some(ClassId(60)));
        assert_eq!(ClassId::from_name("table"), None);
        assert_eq!(ClassId(80).name(), "unknown");
    }

    #[test]
    fn only_similar_class_names_are_suggested() {
        assert_eq!(ClassId::nearest("persn"), Some(ClassId::PERSON));
        assert_eq!(ClassId::nearest("chairs"), Some(ClassId(56)));
        assert_eq!(ClassId::nearest("spaceship"), None);
        assert_eq!(edits("kitten", "sitting"), 3);
    }
}

//! COCO by annotation number, 0 to 90. The data set was planned with 91 classes, of which 80 were annotated; networks of the DETR family
//! still have a score for each number.

use stillpoint_detection::ClassId;

/// Number of annotation numbers, with that of background.
pub(super) const COUNT: usize = 91;

/// Numbers without a class, ascending: background, street sign, hat, shoe, eye glasses, plate, mirror, window, desk, door, blender.
const GAPS: [usize; 11] = [0, 12, 26, 29, 30, 45, 66, 68, 69, 71, 83];

pub(super) fn class(number: usize) -> Option<ClassId> {
    if number >= COUNT || GAPS.contains(&number) {
        return None;
    }
    let below = GAPS.iter().filter(|&&gap| gap < number).count();
    Some(ClassId((number - below) as u8))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coco91_numbers_match_the_annotations() {
        for (number, name) in [
            (1, "person"),
            (11, "fire hydrant"),
            (13, "stop sign"),
            (17, "cat"),
            (27, "backpack"),
            (44, "bottle"),
            (62, "chair"),
            (67, "dining table"),
            (70, "toilet"),
            (72, "tv"),
            (90, "toothbrush"),
        ] {
            assert_eq!(class(number).map(ClassId::name), Some(name), "{number}");
        }
        let named: Vec<ClassId> = (0..COUNT).filter_map(class).collect();
        assert_eq!(named, ClassId::all().collect::<Vec<_>>());
        assert_eq!([0, 12, 91].map(class), [None; 3]);
    }
}

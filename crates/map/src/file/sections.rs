//! Which sections a map has.

/// A part of a map in its file. They come in the order of [`Part::ALL`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Part {
    /// Version of the map, scales of the levels, and how many there are of everything.
    Header,
    /// The cameras, each once.
    Cameras,
    /// Ids, poses, stamps and lengths of the live keyframes.
    Keyframes,
    /// Poses of the culled ones.
    Tombstones,
    /// Pairs of keyframes that share landmarks.
    Covisibility,
    /// Keypoints of all keyframes, one after another.
    Keypoints,
    /// Their undistorted positions and how exact they are.
    Positions,
    /// Their depths.
    Depths,
    /// Their descriptors.
    Descriptors,
    /// Which landmarks they observe, or may not.
    Matches,
    /// What became of each landmark: live, merged, culled.
    LandmarkSlots,
    /// The live landmarks.
    Landmarks,
    /// Their positions and directions.
    LandmarkPositions,
    /// Their descriptors.
    LandmarkDescriptors,
}

impl Part {
    pub(super) const ALL: [Self; 14] = [
        Self::Header,
        Self::Cameras,
        Self::Keyframes,
        Self::Tombstones,
        Self::Covisibility,
        Self::Keypoints,
        Self::Positions,
        Self::Depths,
        Self::Descriptors,
        Self::Matches,
        Self::LandmarkSlots,
        Self::Landmarks,
        Self::LandmarkPositions,
        Self::LandmarkDescriptors,
    ];

    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Header => "header",
            Self::Cameras => "cameras",
            Self::Keyframes => "keyframes",
            Self::Tombstones => "tombstones",
            Self::Covisibility => "covisibility",
            Self::Keypoints => "keypoints",
            Self::Positions => "positions",
            Self::Depths => "depths",
            Self::Descriptors => "descriptors",
            Self::Matches => "matches",
            Self::LandmarkSlots => "landmark slots",
            Self::Landmarks => "landmarks",
            Self::LandmarkPositions => "landmark positions",
            Self::LandmarkDescriptors => "landmark descriptors",
        }
    }

    /// Whether it may be compressed. Descriptors are noise. Of the others each element asks for many times its size in
    /// memory, and may ask for no more than that.
    pub(super) fn may_compress(self) -> bool {
        match self {
            Self::Header | Self::Cameras | Self::Keyframes | Self::Tombstones => false,
            Self::Descriptors | Self::LandmarkSlots | Self::LandmarkDescriptors => false,
            Self::Covisibility | Self::Keypoints | Self::Positions | Self::Depths => true,
            Self::Matches | Self::Landmarks | Self::LandmarkPositions => true,
        }
    }
}

/// How many there are of everything, as the header says.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Counts {
    pub(super) cameras: u32,
    /// One more than the largest keyframe id.
    pub(super) keyframe_slots: u32,
    pub(super) keyframes: u32,
    pub(super) tombstones: u32,
    pub(super) covisible_pairs: u32,
    pub(super) landmark_slots: u32,
    pub(super) landmarks: u32,
    /// Of all live keyframes.
    pub(super) features: u64,
}

/// No keyframe, no landmark, and in the slots of landmarks: live.
pub(super) const NONE: u32 = u32::MAX;
/// In the slots of landmarks: culled. Anything smaller is the landmark it was merged into.
pub(super) const CULLED: u32 = u32::MAX - 1;
/// A slot of a keyframe costs no memory as long as its neighbours are empty too, but time whenever all are looked at: this
/// is a week of frames at 25 Hz.
pub(super) const MAX_KEYFRAME_SLOTS: usize = 1 << 24;

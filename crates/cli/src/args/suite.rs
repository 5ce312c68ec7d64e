//! The public data sets that commands take by their names.

use clap::ValueEnum;

/// A public data set, as far as it is about things that move.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Suite {
    /// TUM RGB-D, dynamic objects: freiburg3 walking and sitting, freiburg2 desk with person
    TumDynamic,
    /// Bonn RGB-D Dynamic
    Bonn,
}

impl Suite {
    /// The name, as the option takes it.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::TumDynamic => "tum-dynamic",
            Self::Bonn => "bonn",
        }
    }
}

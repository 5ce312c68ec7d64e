//! Download addresses of the suites' sequences.

use crate::bench::suite::catalogue::{Known, Suite};
use crate::failure::Failure;
use crate::spelling;
use clap::ValueEnum;
use stillpoint::fetch::archive::Packing;

/// Maximum share of edits for a name to count as mistyped.
const MISTYPED: f64 = 0.3;

pub(crate) struct Origin {
    /// Its server; a mirror replaces this part.
    pub(crate) server: &'static str,
    pub(crate) page: &'static str,
    pub(crate) licence: &'static str,
    pub(crate) packing: Packing,
}

const TUM: Origin = Origin {
    server: "https://cvg.cit.tum.de",
    page: "https://cvg.cit.tum.de/data/datasets/rgbd-dataset",
    licence: "CC BY 4.0",
    packing: Packing::TarGz,
};

const BONN: Origin = Origin {
    server: "https://www.ipb.uni-bonn.de",
    page: "https://www.ipb.uni-bonn.de/data/rgbd-dynamic-dataset/",
    licence: "see its page, which says how to cite it",
    packing: Packing::Zip,
};

impl Suite {
    pub(crate) fn origin(self) -> &'static Origin {
        match self {
            Self::TumDynamic => &TUM,
            Self::Bonn => &BONN,
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Sequence {
    pub(crate) suite: Suite,
    pub(crate) known: &'static Known,
}

impl Sequence {
    pub(crate) fn all() -> impl Iterator<Item = Self> {
        let suites = Suite::value_variants().iter();
        suites.flat_map(|suite| Self::of(*suite))
    }

    pub(crate) fn of(suite: Suite) -> impl Iterator<Item = Self> {
        let known = suite.sequences().iter();
        known.map(move |known| Self { suite, known })
    }

    /// The short name, such as `fr3_walking_xyz`.
    pub(crate) fn name(self) -> String {
        let camera = self.known.camera.last().unwrap_or(&"");
        format!("{camera}_{}", self.known.name)
    }

    /// The camera as its data set spells it.
    fn camera(self) -> &'static str {
        self.known.camera.first().unwrap_or(&"")
    }

    /// The folder's name, as published.
    pub(crate) fn folder(self) -> String {
        let set = match self.suite {
            Suite::TumDynamic => "rgbd_dataset",
            Suite::Bonn => "rgbd",
        };
        format!("{set}_{}_{}", self.camera(), self.known.name)
    }

    pub(crate) fn file(self) -> String {
        let ending = match self.suite.origin().packing {
            Packing::TarGz => "tgz",
            Packing::Zip => "zip",
        };
        format!("{}.{ending}", self.folder())
    }

    /// The address, at the mirror if given.
    pub(crate) fn address(self, mirror: Option<&str>) -> String {
        let server = mirror.unwrap_or(self.suite.origin().server);
        let server = server.trim_end_matches('/');
        let file = self.file();
        match self.suite {
            Suite::TumDynamic => format!("{server}/rgbd/dataset/{}/{file}", self.camera()),
            Suite::Bonn => format!("{server}/html/projects/rgbd_dynamic2019/{file}"),
        }
    }
}

/// Resolves a name: a sequence by its folder's name in any common form, or all of a suite.
pub(crate) fn named(name: &str) -> Result<Vec<Sequence>, Failure> {
    let suites = Suite::value_variants();
    if let Some(suite) = suites.iter().find(|s| s.name() == name) {
        return Ok(Sequence::of(*suite).collect());
    }
    let known = |suite: &Suite| {
        let known = suite.recognise(name)?;
        Some(Sequence {
            suite: *suite,
            known,
        })
    };
    if let Some(sequence) = suites.iter().find_map(known) {
        return Ok(vec![sequence]);
    }
    let names: Vec<String> = Sequence::all().map(Sequence::name).collect();
    let mut names: Vec<&str> = names.iter().map(String::as_str).collect();
    names.extend(suites.iter().map(|s| s.name()));
    let advice = match spelling::near(&name.to_lowercase(), &names, MISTYPED) {
        Some(meant) => format!("did you mean \"{meant}\"?"),
        None => "`stillpoint datasets list` shows what there is".to_owned(),
    };
    Err(Failure::input(format!(
        "datasets pull: expected a known sequence such as fr3_walking_xyz, or a suite (tum-dynamic, bonn), found \"{name}\"; {advice}"
    )))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn download_addresses_are_the_official_ones() {
        let address = |name: &str| named(name).unwrap()[0].address(None);
        for (name, expected) in [
            (
                "fr3_walking_xyz",
                "https://cvg.cit.tum.de/rgbd/dataset/freiburg3/rgbd_dataset_freiburg3_walking_xyz.tgz",
            ),
            (
                "rgbd_dataset_freiburg2_desk_with_person",
                "https://cvg.cit.tum.de/rgbd/dataset/freiburg2/rgbd_dataset_freiburg2_desk_with_person.tgz",
            ),
            (
                "bonn_crowd2",
                "https://www.ipb.uni-bonn.de/html/projects/rgbd_dynamic2019/rgbd_bonn_crowd2.zip",
            ),
        ] {
            assert_eq!(address(name), expected);
        }
        let sequence = named("bonn_crowd").unwrap()[0];
        assert_eq!(
            sequence.address(Some("http://mirror/")),
            "http://mirror/html/projects/rgbd_dynamic2019/rgbd_bonn_crowd.zip"
        );
        for sequence in Sequence::all() {
            assert_eq!(named(&sequence.name()).unwrap(), [sequence]);
            // `bench --suite` must find the pulled folder.
            let found = sequence.suite.recognise(&sequence.folder());
            assert_eq!(found, Some(sequence.known));
        }
        assert_eq!(named("tum-dynamic").unwrap().len(), 9);
        assert_eq!(named("bonn").unwrap().len(), 26);
    }

    #[test]
    fn mistyped_sequence_names_get_suggestions() {
        for (name, part) in [
            ("fr3_walkin_xyz", "did you mean \"fr3_walking_xyz\"?"),
            ("bon", "did you mean \"bonn\"?"),
            ("kitti_00", "datasets list"),
            ("", "datasets list"),
        ] {
            let said = named(name).unwrap_err().to_string();
            assert!(said.contains(part), "{name}: {said}");
        }
    }
}

//! Random changes of checkpoints: reading always ends without panic.

use super::support::{error_of, fixture, program, with_pickle};
use proptest::prelude::*;
use stillpoint_models::import::import_checkpoint;

proptest! {
    /// Any change of bytes is detected or harmless; mostly a checksum detects it.
    #[test]
    fn changed_files_never_panic(changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..4)) {
        let mut bytes = fixture("idetect.pt");
        for (at, value) in changes {
            let at = at.index(bytes.len());
            bytes[at] = value;
        }
        let _ = import_checkpoint(&bytes, "x");
    }

    /// Changes in the directory at the archive's end, which no checksum covers.
    #[test]
    fn changed_directories_never_panic(changes in prop::collection::vec((0_usize..24_000, any::<u8>()), 1..4)) {
        let mut bytes = fixture("idetect.pt");
        for (at, value) in changes {
            let at = bytes.len() - 1 - at;
            bytes[at] = value;
        }
        let _ = import_checkpoint(&bytes, "x");
    }

    /// Changes in the pickle with correct checksums: they reach the pickle's reader and later steps.
    #[test]
    fn changed_pickles_never_panic(changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..8)) {
        let bytes = with_pickle("idetect.pt", |mut pickle| {
            for (at, value) in changes {
                let at = at.index(pickle.len());
                pickle[at] = value;
            }
            pickle
        });
        let _ = import_checkpoint(&bytes, "x");
    }

    /// Moved parts of the pickle: valid opcodes in unintended order.
    #[test]
    fn rearranged_pickles_never_panic(from in any::<prop::sample::Index>(), length in 1_usize..4000, to in any::<prop::sample::Index>()) {
        let bytes = with_pickle("idetect.pt", |mut pickle| {
            let from = from.index(pickle.len());
            let part = pickle[from..(from + length).min(pickle.len())].to_vec();
            let to = to.index(pickle.len());
            pickle.splice(to..to, part);
            pickle
        });
        let _ = import_checkpoint(&bytes, "x");
    }

    #[test]
    fn any_pickle_never_panics(opcodes in prop::collection::vec(any::<u8>(), 0..300)) {
        error_of(&program(&opcodes));
    }
}

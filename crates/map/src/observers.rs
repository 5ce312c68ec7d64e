//! Who observes a landmark.

use crate::KeyframeId;
use std::ops::Deref;

/// Observations of one landmark, keyframe and feature, by keyframe. Where there are none this is a pointer alone: of the landmarks that
/// a camera makes in hours most are gone, and their ids stay.
#[derive(Clone, Debug, Default)]
#[allow(clippy::box_collection)] // That is the point.
pub(crate) struct Observers(Option<Box<Vec<(KeyframeId, u32)>>>);

impl Observers {
    /// Adds an observation at a place of the list.
    pub(crate) fn insert(&mut self, at: usize, observation: (KeyframeId, u32)) {
        self.0.get_or_insert_default().insert(at, observation);
    }

    /// Takes one out.
    pub(crate) fn remove(&mut self, at: usize) -> Option<(KeyframeId, u32)> {
        let list = self.0.as_mut()?;
        (at < list.len()).then(|| list.remove(at))
    }
}

impl Deref for Observers {
    type Target = [(KeyframeId, u32)];

    fn deref(&self) -> &Self::Target {
        self.0.as_ref().map_or(&[], |list| list.as_slice())
    }
}

impl From<Vec<(KeyframeId, u32)>> for Observers {
    fn from(list: Vec<(KeyframeId, u32)>) -> Self {
        Self((!list.is_empty()).then(|| Box::new(list)))
    }
}

impl IntoIterator for Observers {
    type Item = (KeyframeId, u32);
    type IntoIter = std::vec::IntoIter<Self::Item>;

    fn into_iter(self) -> Self::IntoIter {
        self.0.map_or_else(Vec::new, |list| *list).into_iter()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_list_that_is_small_when_it_is_empty() {
        assert!(size_of::<Observers>() <= 8);
        let one = |k: u32| (KeyframeId(k), 10 * k);
        let mut list = Observers::from(Vec::new());
        assert!(list.is_empty() && list.0.is_none());
        assert_eq!(list.remove(0), None);
        list.insert(0, one(4));
        list.insert(0, one(2));
        assert_eq!(*list, [one(2), one(4)]);
        assert_eq!((list.remove(2), list.remove(0)), (None, Some(one(2))));
        assert_eq!(list.clone().into_iter().collect::<Vec<_>>(), [one(4)]);
        assert!(std::mem::take(&mut list).len() == 1 && list.is_empty());
    }
}

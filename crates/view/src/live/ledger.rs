//! Numbered values with the version of their last change, so that readers can request the changes since any version.
//!
//! Each reader requests at its own pace: a slow one gets fewer updates with the newest values, and no per-reader state is kept.

use std::collections::{BTreeMap, VecDeque};

/// Number of remembered removals. Readers older than the oldest of them get everything.
const REMEMBERED: usize = 50_000;

#[derive(Clone, Debug)]
pub(super) struct Ledger<V> {
    entries: BTreeMap<u32, Entry<V>>,
    /// Versions and numbers of removed values, in order.
    removed: VecDeque<(u64, u32)>,
    changed: u64,
    /// The version of the newest forgotten removal.
    forgotten: u64,
    remembered: usize,
}

#[derive(Clone, Debug)]
struct Entry<V> {
    value: V,
    version: u64,
}

#[derive(Clone, Debug, PartialEq)]
pub(super) struct Changes<'a, V> {
    /// Whether all earlier values must be discarded.
    pub(super) whole: bool,
    /// Removed values; to be applied first.
    pub(super) removed: Vec<u32>,
    pub(super) set: Vec<(u32, &'a V)>,
}

impl<V> Default for Ledger<V> {
    fn default() -> Self {
        Self {
            entries: BTreeMap::new(),
            removed: VecDeque::new(),
            changed: 0,
            forgotten: 0,
            remembered: REMEMBERED,
        }
    }
}

impl<V> Ledger<V> {
    pub(super) fn len(&self) -> usize {
        self.entries.len()
    }

    pub(super) fn get(&self, number: u32) -> Option<&V> {
        self.entries.get(&number).map(|e| &e.value)
    }

    /// The values in the order of their numbers.
    #[cfg(test)]
    pub(super) fn iter(&self) -> impl DoubleEndedIterator<Item = (u32, &V)> {
        self.entries.iter().map(|(number, e)| (*number, &e.value))
    }

    /// Sets a value. Versions must not decrease.
    pub(super) fn set(&mut self, version: u64, number: u32, value: V) {
        self.changed = version;
        self.entries.insert(number, Entry { value, version });
    }

    /// Modifies values in place; `change` returns whether it did.
    pub(super) fn revise(&mut self, version: u64, mut change: impl FnMut(u32, &mut V) -> bool) {
        for (number, entry) in &mut self.entries {
            if change(*number, &mut entry.value) {
                entry.version = version;
                self.changed = version;
            }
        }
    }

    /// Removes values that `keep` rejects.
    pub(super) fn retain(&mut self, version: u64, mut keep: impl FnMut(u32, &V) -> bool) {
        let removed = &mut self.removed;
        let before = removed.len();
        self.entries.retain(|number, entry| {
            let kept = keep(*number, &entry.value);
            if !kept {
                removed.push_back((version, *number));
            }
            kept
        });
        if removed.len() > before {
            self.changed = version;
        }
        while self.removed.len() > self.remembered
            && let Some((version, _)) = self.removed.pop_front()
        {
            self.forgotten = version;
        }
    }

    /// The changes after a version; everything for version 0.
    pub(super) fn since(&self, version: u64) -> Changes<'_, V> {
        let whole = version < self.forgotten || version == 0;
        if version >= self.changed && !whole {
            return Changes {
                whole,
                removed: Vec::new(),
                set: Vec::new(),
            };
        }
        let from = self.removed.partition_point(|(v, _)| *v <= version);
        let removed = self
            .removed
            .iter()
            .skip(if whole { usize::MAX } else { from });
        let set = self.entries.iter();
        let set = set.filter(|(_, e)| whole || e.version > version);
        Changes {
            whole,
            removed: removed.map(|(_, number)| *number).collect(),
            set: set.map(|(number, e)| (*number, &e.value)).collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[derive(Clone, Debug)]
    enum Step {
        Set(u32, u8),
        Revise(u8),
        Keep(u32),
        Read(usize),
    }

    fn step() -> impl Strategy<Value = Step> {
        prop_oneof![
            (0..20_u32, any::<u8>()).prop_map(|(n, v)| Step::Set(n, v)),
            any::<u8>().prop_map(Step::Revise),
            (2..5_u32).prop_map(Step::Keep),
            (0..3_usize).prop_map(Step::Read),
        ]
    }

    fn read(ledger: &Ledger<u8>, known: &mut (u64, BTreeMap<u32, u8>), now: u64) {
        let changes = ledger.since(known.0);
        if changes.whole {
            known.1.clear();
        }
        for number in changes.removed {
            known.1.remove(&number);
        }
        known
            .1
            .extend(changes.set.into_iter().map(|(n, v)| (n, *v)));
        known.0 = now;
    }

    proptest! {
        #[test]
        fn readers_reconstruct_the_state_at_any_version(steps in prop::collection::vec(step(), 1..200), remembered in 0..6_usize) {
            let mut ledger = Ledger { remembered, ..Ledger::default() };
            let mut readers = vec![(0, BTreeMap::new()); 3];
            let mut now = 0;
            for step in steps {
                match step {
                    Step::Read(reader) => {
                        read(&ledger, &mut readers[reader], now);
                        let all: BTreeMap<u32, u8> = ledger.iter().map(|(n, v)| (n, *v)).collect();
                        prop_assert_eq!(&readers[reader].1, &all);
                        // An immediate second request gets no changes.
                        if now > 0 {
                            let again = ledger.since(now);
                            prop_assert!(!again.whole && again.set.is_empty() && again.removed.is_empty());
                        }
                        continue;
                    }
                    _ => now += 1,
                }
                match step {
                    Step::Set(number, value) => ledger.set(now, number, value),
                    Step::Revise(value) => ledger.revise(now, |number, old| {
                        let other = number % 3 == 0 && *old != value;
                        if other { *old = value; }
                        other
                    }),
                    Step::Keep(one_in) => ledger.retain(now, |number, _| number % one_in != 0),
                    Step::Read(_) => {}
                }
                prop_assert!(ledger.removed.len() <= remembered);
            }
        }
    }

    #[test]
    fn reader_gets_only_changes() {
        let mut ledger = Ledger::default();
        (0..1000).for_each(|n| ledger.set(1, n, n));
        ledger.set(2, 7, 70);
        ledger.retain(3, |n, _| n != 9);
        let changes = ledger.since(1);
        assert_eq!((changes.whole, &*changes.removed), (false, &[9][..]));
        assert_eq!(changes.set, [(7, &70)]);
        assert_eq!(ledger.since(0).set.len(), 999);
    }
}

//! Reuse of buffers, so that tracking allocates nothing per frame once running.

use std::sync::Arc;

/// A shared value written by `fill`, in the memory of `spent` if that has no other owner.
pub(crate) fn refill<T: Default>(spent: Option<Arc<T>>, fill: impl FnOnce(&mut T)) -> Arc<T> {
    refill_or(spent, T::default, fill)
}

/// Likewise for types without a default.
pub(crate) fn refill_or<T>(
    spent: Option<Arc<T>>,
    nothing: impl FnOnce() -> T,
    fill: impl FnOnce(&mut T),
) -> Arc<T> {
    if let Some(mut value) = spent
        && let Some(own) = Arc::get_mut(&mut value)
    {
        fill(own);
        return value;
    }
    let mut value = nothing();
    fill(&mut value);
    Arc::new(value)
}

#[derive(Clone, Debug)]
pub(crate) struct Lists<T>(Vec<Vec<T>>);

/// Maximum number of pooled buffers of a kind: no frame uses more at once. Measured: a steady frame allocates only
/// memory that leaves with its report (docs/scale.md).
pub(crate) const MOST: usize = 8;

impl<T> Default for Lists<T> {
    fn default() -> Self {
        Self(Vec::new())
    }
}

impl<T> Lists<T> {
    pub(crate) fn take(&mut self) -> Vec<T> {
        self.0.pop().unwrap_or_default()
    }

    pub(crate) fn give(&mut self, mut list: Vec<T>) {
        if self.0.len() < MOST && list.capacity() > 0 {
            list.clear();
            self.0.push(list);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn buffer_is_reused_unless_shared() {
        let first = refill(None, |v: &mut Vec<u8>| v.push(1));
        let place = Arc::as_ptr(&first);
        let second = refill(Some(first), |v| v.push(2));
        assert_eq!((&second[..], Arc::as_ptr(&second)), (&[1, 2][..], place));
        let third = refill(Some(Arc::clone(&second)), |v| v.push(3));
        assert_eq!((&second[..], &third[..]), (&[1, 2][..], &[3][..]));
    }

    #[test]
    fn recycled_lists_are_empty_and_keep_capacity() {
        let mut lists = Lists::default();
        lists.give(vec![1, 2, 3]);
        let again: Vec<i32> = lists.take();
        assert!(again.is_empty() && again.capacity() >= 3);
        assert_eq!(lists.take().capacity(), 0);
        (0..20).for_each(|_| lists.give(vec![1]));
        assert_eq!(lists.0.len(), MOST);
    }
}

use std::collections::VecDeque;
use std::sync::Arc;

use parking_lot::Mutex;

/// Values kept.
const MOST: usize = 4;

/// The values computed last, newest first, each with everything that it depends on. Many runs in one process have few
/// rigs, and what is computed of a rig takes as long as several control cycles.
pub(super) struct Kept<K, V>(Mutex<VecDeque<(K, Arc<V>)>>);

impl<K: PartialEq, V> Kept<K, V> {
    pub const fn new() -> Self {
        Self(Mutex::new(VecDeque::new()))
    }

    /// The value of `key`. Two threads that ask for the same new value at once both compute it, so that no thread
    /// waits for a value that it does not need.
    pub fn get(&self, key: K, compute: impl FnOnce(&K) -> V) -> Arc<V> {
        if let Some((_, value)) = self.0.lock().iter().find(|(kept, _)| *kept == key) {
            return Arc::clone(value);
        }
        let value = Arc::new(compute(&key));
        let mut kept = self.0.lock();
        kept.push_front((key, Arc::clone(&value)));
        kept.truncate(MOST);
        value
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kept_values_are_those_asked_for() {
        let kept = Kept::new();
        for i in (0..2 * (MOST + 2)).map(|i| i % (MOST + 2)) {
            assert_eq!((*kept.get(i, |&i| 10 * i), *kept.get(i, |_| unreachable!())), (10 * i, 10 * i));
            assert!(kept.0.lock().len() <= MOST);
        }
    }
}

use std::collections::VecDeque;
use std::sync::Arc;

use parking_lot::Mutex;

/// Number of values.
const CAPACITY: usize = 4;

/// The values used last, newest first, each with everything that it depends on. Many runs in one process have few
/// rigs, and what is computed of a rig takes as long as several control cycles.
pub(super) struct Cache<K, V>(Mutex<VecDeque<(K, Arc<V>)>>);

impl<K: PartialEq, V> Cache<K, V> {
    pub const fn new() -> Self {
        Self(Mutex::new(VecDeque::new()))
    }

    /// The value of `key`. Two threads that ask for the same new value at once both compute it, so that no thread
    /// waits for a value that it does not need.
    pub fn get(&self, key: K, compute: impl FnOnce(&K) -> V) -> Arc<V> {
        if let Some(value) = find(&mut self.0.lock(), &key) {
            return value;
        }
        let value = Arc::new(compute(&key));
        let mut values = self.0.lock();
        if let Some(other) = find(&mut values, &key) {
            return other;
        }
        values.push_front((key, Arc::clone(&value)));
        values.truncate(CAPACITY);
        value
    }
}

/// The value of `key`, now the newest.
fn find<K: PartialEq, V>(values: &mut VecDeque<(K, Arc<V>)>, key: &K) -> Option<Arc<V>> {
    let at = values.iter().position(|(of, _)| of == key)?;
    values.make_contiguous()[..=at].rotate_right(1);
    values.front().map(|(_, value)| Arc::clone(value))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_those_asked_for_and_those_in_use_stay() {
        let cache = Cache::new();
        for i in (1..2 * (CAPACITY + 2)).map(|i| i % (CAPACITY + 2)) {
            assert_eq!((*cache.get(i, |&i| 10 * i), *cache.get(i, |_| unreachable!())), (10 * i, 10 * i));
            assert_eq!(*cache.get(100, |_| if i == 1 { 7 } else { unreachable!() }), 7);
            assert!(cache.0.lock().len() <= CAPACITY);
        }
    }

    #[test]
    fn value_that_several_threads_computed_at_once_has_one_place() {
        let (cache, barrier) = (Cache::new(), std::sync::Barrier::new(CAPACITY));
        std::thread::scope(|scope| {
            for _ in 0..CAPACITY {
                scope.spawn(|| cache.get(1, |_| barrier.wait().is_leader()));
            }
        });
        assert_eq!(cache.0.lock().len(), 1);
    }
}

use std::collections::VecDeque;
use std::sync::{Arc, OnceLock};

use parking_lot::Mutex;

/// Number of values.
const CAPACITY: usize = 4;

/// The values used last, newest first, each with everything that it depends on. Many runs in one process have few
/// rigs, and what is computed of a rig takes as long as several control cycles.
pub(super) struct Cache<K, V>(Mutex<VecDeque<(K, Place<V>)>>);

/// A value, once it is computed.
type Place<V> = Arc<OnceLock<Arc<V>>>;

impl<K: Clone + PartialEq, V> Cache<K, V> {
    pub const fn new() -> Self {
        Self(Mutex::new(VecDeque::new()))
    }

    /// The value of `key`. A thread that asks for it while another computes it waits, and for that value alone.
    pub fn get(&self, key: K, compute: impl FnOnce(&K) -> V) -> Arc<V> {
        let place = self.place(&key);
        Arc::clone(place.get_or_init(|| Arc::new(compute(&key))))
    }

    /// The place of `key`, now the newest.
    fn place(&self, key: &K) -> Place<V> {
        let mut values = self.0.lock();
        let known = values.iter().position(|(of, _)| of == key).and_then(|at| values.remove(at));
        let (_, place) = values.push_front_mut(known.unwrap_or_else(|| (key.clone(), Place::default())));
        let place = Arc::clone(place);
        values.truncate(CAPACITY);
        place
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};

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
    fn value_that_several_threads_ask_for_at_once_is_computed_once() {
        let (cache, barrier) = (Cache::new(), std::sync::Barrier::new(CAPACITY));
        let computed = AtomicUsize::new(0);
        std::thread::scope(|scope| {
            for _ in 0..CAPACITY {
                scope.spawn(|| {
                    barrier.wait();
                    cache.get(1, |_| computed.fetch_add(1, Ordering::Relaxed))
                });
            }
        });
        assert_eq!(computed.into_inner(), 1);
    }
}

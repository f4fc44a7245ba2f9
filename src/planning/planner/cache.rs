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

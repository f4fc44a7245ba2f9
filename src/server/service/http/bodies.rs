use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

/// The memory that all request bodies together may take. Copies are the same room.
#[derive(Clone, Debug)]
pub struct BodyRoom(Arc<AtomicUsize>);

impl BodyRoom {
    /// Room for this many bytes.
    pub fn of(bytes: usize) -> Self {
        Self(Arc::new(AtomicUsize::new(bytes)))
    }

    /// Room for one body, none of it taken yet.
    pub(super) fn for_one(&self) -> HeldRoom {
        HeldRoom { room: self.clone(), bytes: 0 }
    }
}

/// What one body takes of a [`BodyRoom`]; free again when it is dropped.
#[derive(Debug)]
pub(in crate::service) struct HeldRoom {
    room: BodyRoom,
    bytes: usize,
}

impl HeldRoom {
    /// Takes `bytes` in all. False when there is not so much: then it keeps what it has.
    pub(super) fn grow_to(&mut self, bytes: usize) -> bool {
        let more = bytes.saturating_sub(self.bytes);
        let take = |left: usize| left.checked_sub(more);
        let taken = self.room.0.fetch_update(Ordering::AcqRel, Ordering::Acquire, take).is_ok();
        if taken {
            self.bytes += more;
        }
        taken
    }
}

impl Drop for HeldRoom {
    fn drop(&mut self) {
        self.room.0.fetch_add(self.bytes, Ordering::AcqRel);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bodies_together_take_no_more_than_the_room() {
        let room = BodyRoom::of(10);
        let (mut first, mut second) = (room.for_one(), room.for_one());
        assert!(first.grow_to(6) && first.grow_to(3), "a body does not shrink");
        assert!(second.grow_to(4) && !second.grow_to(5));
        drop(first);
        assert!(second.grow_to(10));
    }
}

//! How many files and sockets the process may have open.

/// Lets the process have `wanted` of them open at once, where it may; how many it may now.
#[cfg(unix)]
pub(super) fn make_room(wanted: u64) -> u64 {
    use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};

    let limit = getrlimit(Resource::Nofile);
    let present = limit.current.unwrap_or(u64::MAX);
    let most = limit.maximum.unwrap_or(u64::MAX).min(wanted);
    if most <= present {
        return present;
    }
    let raised = Rlimit { current: Some(most), maximum: limit.maximum };
    setrlimit(Resource::Nofile, raised).map_or(present, |()| most)
}

/// Elsewhere there is no such limit to raise.
#[cfg(not(unix))]
pub(super) fn make_room(wanted: u64) -> u64 {
    wanted
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    #[test]
    fn there_is_never_less_room_than_before() {
        let before = make_room(0);
        assert_eq!(make_room(1), before);
        let more = make_room(before.saturating_add(1));
        assert!(more == before || more == before + 1);
        assert_eq!(make_room(0), more);
    }
}

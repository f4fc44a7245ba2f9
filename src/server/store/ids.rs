use std::fmt;

use jiff::Timestamp;
use serde::{Deserialize, Serialize};
use uuid::{NoContext, Uuid};

/// Id of a job: 32 hex digits that sort by the order in which jobs were accepted. No other text of a request ever names
/// a job or a folder.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct JobId(#[serde(with = "uuid::serde::simple")] Uuid);

/// Bits below the milliseconds since 1970 with which an id begins.
const TIME_SHIFT: u32 = 80;

impl JobId {
    /// Parses exactly 32 lower-case hex digits.
    pub fn parse(text: &str) -> Option<Self> {
        Uuid::try_parse(text).ok().map(Self).filter(|id| id.to_string() == text)
    }

    /// An id of this time, above `last` even when the wall clock goes back. It is drawn, so that the id of a deleted
    /// job is not given again.
    pub(super) fn next(last: Option<Self>, now: Timestamp) -> Self {
        let after_ms = last.map_or(0, |Self(last)| (last.as_u128() >> TIME_SHIFT) as u64 + 1);
        let drawn = |ms: u64| {
            let time = uuid::Timestamp::from_unix(NoContext, ms / 1000, (ms % 1000) as u32 * 1_000_000);
            Self(Uuid::new_v7(time))
        };
        let id = drawn(now.as_millisecond().max(0).unsigned_abs());
        if last < Some(id) { id } else { drawn(after_ms) }
    }
}

impl fmt::Display for JobId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.simple().fmt(f)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn only_plain_ids_are_read() {
        let id = JobId::next(None, Timestamp::UNIX_EPOCH);
        assert_eq!(JobId::parse(&id.to_string()), Some(id));
        let upper = id.to_string().to_uppercase();
        let dashed = id.0.hyphenated().to_string();
        let odd = ["", "..", "0", "../../../../etc/passwd/././././.", "0000000000000000000000000000000g", &dashed];
        for text in odd.into_iter().chain((upper != id.to_string()).then_some(upper.as_str())) {
            assert_eq!(JobId::parse(text), None, "{text}");
        }
    }

    #[test]
    fn id_of_a_deleted_job_is_not_given_again() {
        let newest = JobId::next(None, Timestamp::from_second(1000).unwrap());
        let [deleted, next] = [(); 2].map(|()| JobId::next(Some(newest), Timestamp::UNIX_EPOCH));
        assert!(deleted > newest && next > newest && deleted != next);
    }

    proptest! {
        #[test]
        fn ids_rise_under_any_clock(seconds in prop::collection::vec(0_i64..4_000_000_000, 1..40)) {
            let mut last = None;
            for second in seconds {
                let next = JobId::next(last, Timestamp::from_second(second).unwrap());
                prop_assert!(last < Some(next), "{last:?} {next:?}");
                last = Some(next);
            }
        }
    }
}

use std::fmt;

use jiff::Timestamp;
use uuid::{ContextV7, Uuid};

/// Id of a job: 32 hex digits that sort by the order in which jobs were accepted. No other text of a request ever names
/// a job or a folder.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct JobId([u8; 16]);

impl JobId {
    /// Parses exactly 32 lower-case hex digits.
    pub fn parse(text: &str) -> Option<Self> {
        let digit = |byte: u8| matches!(byte, b'0'..=b'9' | b'a'..=b'f');
        let plain = text.len() == 32 && text.bytes().all(digit);
        plain.then(|| Uuid::try_parse(text).ok().map(|uuid| Self(uuid.into_bytes()))).flatten()
    }

    pub(super) const fn from_bytes(bytes: [u8; 16]) -> Self {
        Self(bytes)
    }

    pub(super) fn as_bytes(&self) -> &[u8; 16] {
        &self.0
    }
}

impl fmt::Display for JobId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", Uuid::from_bytes(self.0).simple())
    }
}

impl fmt::Debug for JobId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{self}")
    }
}

/// Generator of ascending ids, even when the wall clock goes back.
#[derive(Debug)]
pub(super) struct Ids(ContextV7);

impl Ids {
    /// A generator of ids above `last`, the greatest one given so far.
    pub fn above(last: Option<JobId>) -> Self {
        let ids = Self(ContextV7::new());
        if let Some(JobId([a, b, c, d, e, f, ..])) = last {
            let last_ms = u64::from_be_bytes([0, 0, a, b, c, d, e, f]);
            ids.at_ms(last_ms + 1);
        }
        ids
    }

    pub fn next(&self, now: Timestamp) -> JobId {
        self.at_ms(now.as_millisecond().max(0).unsigned_abs())
    }

    fn at_ms(&self, ms: u64) -> JobId {
        let subsec_ns = (ms % 1000) as u32 * 1_000_000;
        let uuid = Uuid::new_v7(uuid::Timestamp::from_unix(&self.0, ms / 1000, subsec_ns));
        JobId(uuid.into_bytes())
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn only_plain_ids_are_read() {
        let id = Ids::above(None).next(Timestamp::UNIX_EPOCH);
        assert_eq!(JobId::parse(&id.to_string()), Some(id));
        let upper = id.to_string().to_uppercase();
        let dashed = Uuid::from_bytes(id.0).hyphenated().to_string();
        let odd = ["", "..", "0", "../../../../etc/passwd/././././.", "0000000000000000000000000000000g", &dashed];
        for text in odd.into_iter().chain((upper != id.to_string()).then_some(upper.as_str())) {
            assert_eq!(JobId::parse(text), None, "{text}");
        }
    }

    proptest! {
        #[test]
        fn ids_rise_under_any_clock(seconds in prop::collection::vec(0_i64..4_000_000_000, 1..40), cut in 0_usize..40) {
            let (mut ids, mut last) = (Ids::above(None), None);
            for (i, second) in seconds.into_iter().enumerate() {
                if i == cut {
                    ids = Ids::above(last);
                }
                let next = ids.next(Timestamp::from_second(second).unwrap());
                prop_assert!(last < Some(next), "{last:?} {next:?}");
                last = Some(next);
            }
        }
    }
}

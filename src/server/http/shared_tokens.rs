use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use parking_lot::{Mutex, RwLock};

use axum::http::HeaderMap;
use axum::http::header::AUTHORIZATION;

use super::tokens::{Scope, Tokens};
use super::{Problem, ProblemKind};
use upm_core::time::{Clock, MonotonicClock};

/// Least time between two log entries on wrong tokens.
const LOG_INTERVAL: Duration = Duration::from_secs(60);

/// The accepted tokens, and a count of wrong ones. Copies share both.
#[derive(Clone, Debug)]
pub struct SharedTokens(Arc<TokenCell>);

#[derive(Debug)]
struct TokenCell {
    tokens: RwLock<Tokens>,
    clock: MonotonicClock,
    wrong: Mutex<WrongTokens>,
}

impl SharedTokens {
    /// Accepts `tokens` until they are replaced.
    pub fn new(tokens: Tokens) -> Self {
        let (tokens, clock) = (RwLock::new(tokens), MonotonicClock::new());
        Self(Arc::new(TokenCell { tokens, clock, wrong: Mutex::default() }))
    }

    /// Accepts only `tokens` from now on.
    pub fn replace(&self, tokens: Tokens) {
        *self.0.tokens.write() = tokens;
    }

    /// The caller, if its token grants `needed`. A wrong token is logged, at most once a minute.
    pub(crate) fn admit(
        &self,
        headers: &HeaderMap,
        needed: Scope,
        remote: Option<SocketAddr>,
    ) -> Result<String, Problem> {
        let admitted = self.0.tokens.read().admit(headers, needed);
        let is_wrong = |problem: &Problem| problem.kind() == ProblemKind::Unauthorized;
        if headers.contains_key(AUTHORIZATION) && admitted.as_ref().is_err_and(is_wrong) {
            self.report(|wrong, now| wrong.note(remote, now));
        }
        admitted
    }

    /// Logs wrong tokens that are not logged yet, once a minute has passed.
    pub fn report_wrong(&self) {
        self.report(WrongTokens::due);
    }

    fn report(&self, due: impl FnOnce(&mut WrongTokens, Duration) -> Option<(u64, Option<SocketAddr>)>) {
        let due = due(&mut self.0.wrong.lock(), self.0.clock.elapsed());
        if let Some((requests, remote)) = due {
            let remote = remote.map(|remote| remote.to_string()).unwrap_or_default();
            tracing::warn!(requests, remote, "rejected requests with an unknown token");
        }
    }
}

/// Requests with wrong tokens that are not logged yet.
#[derive(Debug, Default)]
struct WrongTokens {
    count: u64,
    /// Address of the last one.
    remote: Option<SocketAddr>,
    told_at: Option<Duration>,
}

impl WrongTokens {
    fn note(&mut self, remote: Option<SocketAddr>, now: Duration) -> Option<(u64, Option<SocketAddr>)> {
        self.count += 1;
        self.remote = remote;
        self.due(now)
    }

    /// The number to log now, and the address of the last request.
    fn due(&mut self, now: Duration) -> Option<(u64, Option<SocketAddr>)> {
        let is_due = self.told_at.is_none_or(|told_at| now.saturating_sub(told_at) >= LOG_INTERVAL);
        if self.count == 0 || !is_due {
            return None;
        }
        self.told_at = Some(now);
        Some((std::mem::take(&mut self.count), self.remote.take()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wrong_tokens_are_logged_at_once_and_then_once_a_minute() {
        let (mut wrong, s) = (WrongTokens::default(), Duration::from_secs);
        assert_eq!(wrong.due(s(0)), None);
        assert_eq!(wrong.note(None, s(1)), Some((1, None)));
        for at in 2..50 {
            assert_eq!(wrong.note(None, s(at)), None);
        }
        assert_eq!((wrong.due(s(60)), wrong.due(s(61))), (None, Some((48, None))));
        assert_eq!((wrong.due(s(200)), wrong.note(None, s(200))), (None, Some((1, None))));
    }

    #[test]
    fn replaced_tokens_are_refused_and_new_ones_accepted() {
        let one = |secret: &str| {
            let mut tokens = Tokens::default();
            tokens.add("operate", secret, Scope::Operate).unwrap();
            tokens
        };
        let (old, new) = ("o".repeat(32), "n".repeat(32));
        let shared = SharedTokens::new(one(&old));
        let admits = |secret: &str| {
            let headers = [(AUTHORIZATION, format!("Bearer {secret}").parse().unwrap())].into_iter().collect();
            shared.admit(&headers, Scope::Operate, None).is_ok()
        };
        assert_eq!((admits(&old), admits(&new)), (true, false));
        shared.replace(one(&new));
        assert_eq!((admits(&old), admits(&new)), (false, true));
    }
}

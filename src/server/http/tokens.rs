use std::fmt;

use axum::http::header::{AUTHORIZATION, WWW_AUTHENTICATE};
use axum::http::{HeaderMap, HeaderValue};
use sha2::{Digest, Sha256};
use subtle::{Choice, ConditionallySelectable, ConstantTimeEq};

use super::{Problem, ProblemKind};

/// Shortest token, characters.
const SHORTEST_TOKEN: usize = 32;

/// Scope of a token; the larger one includes the smaller.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Scope {
    /// Read, and stop a plate in an emergency.
    Read,
    /// Submit, cancel, reset, resume.
    Operate,
}

impl Scope {
    /// Name of the scope in configuration, OpenAPI document and log.
    pub fn name(self) -> &'static str {
        match self {
            Self::Read => "read",
            Self::Operate => "operate",
        }
    }
}

/// Sender of a request.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Caller {
    /// Name of the token, `local` where none is required, `anonymous` where none was given. Never the token itself.
    pub name: String,
    /// Network address of the sender, where known.
    pub remote: Option<std::net::SocketAddr>,
}

struct Token {
    digest: [u8; 32],
    scope: Scope,
    name: String,
}

/// The accepted bearer tokens. Without any, every client that can connect may do everything, so this is for loopback
/// alone.
#[derive(Default)]
pub struct Tokens(Vec<Token>);

impl fmt::Debug for Tokens {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_list().entries(self.0.iter().map(|token| (&token.name, token.scope))).finish()
    }
}

impl Tokens {
    /// Accepts `secret` as the token called `name`. It must have at least 32 characters, all visible ASCII.
    pub fn add(&mut self, name: &str, secret: &str, scope: Scope) -> Result<(), String> {
        if secret.len() < SHORTEST_TOKEN || !secret.bytes().all(|b| b.is_ascii_graphic()) {
            return Err(format!(
                "token {name}: expected at least {SHORTEST_TOKEN} visible ASCII characters, found {} bytes",
                secret.len()
            ));
        }
        self.0.push(Token { digest: Sha256::digest(secret).into(), scope, name: name.to_owned() });
        Ok(())
    }

    /// True when no token is required.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// The caller's name, if its token grants `needed`.
    pub(crate) fn admit(&self, headers: &HeaderMap, needed: Scope) -> Result<String, Problem> {
        if self.is_empty() {
            return Ok("local".to_owned());
        }
        let presented = presented(headers)?;
        let Some(token) = self.find(presented) else {
            return Err(unauthorized("the token is not one of this daemon's", "invalid_token"));
        };
        if token.scope < needed {
            let detail = format!("the token may {}, this needs one that may {}", token.scope.name(), needed.name());
            return Err(challenge(Problem::new(ProblemKind::Forbidden, detail), "insufficient_scope"));
        }
        Ok(token.name.clone())
    }

    /// Finds the token in a time that depends only on the number of tokens: all are compared, by digest, so the time
    /// reveals neither length nor content of the text that was sent.
    fn find(&self, presented: &[u8]) -> Option<&Token> {
        let digest: [u8; 32] = Sha256::digest(presented).into();
        let (mut found, mut at) = (Choice::from(0), 0u32);
        for (i, token) in self.0.iter().enumerate() {
            let equal = token.digest.ct_eq(&digest);
            at.conditional_assign(&u32::try_from(i).unwrap_or(u32::MAX), equal);
            found |= equal;
        }
        bool::from(found).then(|| self.0.get(at as usize)).flatten()
    }
}

/// The text after `Bearer` in the one Authorization header.
fn presented(headers: &HeaderMap) -> Result<&[u8], Problem> {
    let mut values = headers.get_all(AUTHORIZATION).iter();
    let value = match (values.next(), values.next()) {
        (Some(value), None) => value.as_bytes(),
        (None, _) => return Err(challenge_without_error()),
        (Some(_), Some(_)) => return Err(unauthorized("more than one Authorization header", "invalid_request")),
    };
    let (scheme, token) = value.split_at(value.iter().position(|b| *b == b' ').unwrap_or(value.len()));
    if !scheme.eq_ignore_ascii_case(b"bearer") {
        return Err(unauthorized("the Authorization header is not of the form `Bearer TOKEN`", "invalid_request"));
    }
    Ok(token.trim_ascii())
}

fn challenge_without_error() -> Problem {
    let problem = Problem::new(ProblemKind::Unauthorized, "send `Authorization: Bearer TOKEN`");
    problem.with_header(WWW_AUTHENTICATE, HeaderValue::from_static("Bearer realm=\"upm\""))
}

fn unauthorized(detail: &str, error: &'static str) -> Problem {
    challenge(Problem::new(ProblemKind::Unauthorized, detail), error)
}

fn challenge(problem: Problem, error: &str) -> Problem {
    match HeaderValue::from_str(&format!("Bearer realm=\"upm\", error=\"{error}\"")) {
        Ok(value) => problem.with_header(WWW_AUTHENTICATE, value),
        Err(_) => problem,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const READING: &str = "look-look-look-look-look-look-look";
    const WORK: &str = "work-work-work-work-work-work-work";

    fn tokens() -> Tokens {
        let mut tokens = Tokens::default();
        tokens.add("desk", WORK, Scope::Operate).unwrap();
        tokens.add("screen", READING, Scope::Read).unwrap();
        tokens
    }

    fn admit(values: &[&str], needed: Scope) -> Result<String, u16> {
        let mut headers = HeaderMap::new();
        for value in values {
            headers.append(AUTHORIZATION, HeaderValue::from_str(value).unwrap());
        }
        tokens().admit(&headers, needed).map_err(|problem| problem.kind().status().as_u16())
    }

    #[test]
    fn scopes_hold() {
        let (reading, work) = (format!("Bearer {READING}"), format!("bEaReR   {WORK} "));
        assert_eq!(admit(&[&reading], Scope::Read), Ok("screen".to_owned()));
        assert_eq!(admit(&[&reading], Scope::Operate), Err(403));
        assert_eq!(admit(&[&work], Scope::Read), Ok("desk".to_owned()));
        assert_eq!(admit(&[&work], Scope::Operate), Ok("desk".to_owned()));
    }

    #[test]
    fn malformed_or_unknown_token_is_rejected() {
        let longer = format!("Bearer {WORK}x");
        let shorter = format!("Bearer {}", &WORK[1..]);
        let (basic, bare, glued) = (format!("Basic {WORK}"), WORK.to_owned(), format!("Bearer{WORK}"));
        let two = format!("Bearer {WORK}, Bearer {WORK}");
        for value in ["", "Bearer", "Bearer ", &longer, &shorter, &basic, &bare, &glued, &two] {
            assert_eq!(admit(&[value], Scope::Read), Err(401), "{value:?}");
        }
        let good = format!("Bearer {WORK}");
        assert_eq!(admit(&[&good, &good], Scope::Read), Err(401));
        assert_eq!(admit(&[], Scope::Read), Err(401));
    }

    #[test]
    fn without_tokens_every_caller_is_local() {
        assert_eq!(Tokens::default().admit(&HeaderMap::new(), Scope::Operate), Ok("local".to_owned()));
    }

    #[test]
    fn weak_tokens_are_refused_and_none_is_shown() {
        let mut tokens = tokens();
        assert!(tokens.add("short", "x", Scope::Read).is_err());
        assert!(tokens.add("line", &format!("{WORK}\n"), Scope::Read).is_err());
        assert_eq!(format!("{tokens:?}"), r#"[("desk", Operate), ("screen", Read)]"#);
    }
}

use std::fmt;

use axum::http::header::{AUTHORIZATION, WWW_AUTHENTICATE};
use axum::http::{HeaderMap, HeaderValue, StatusCode};
use parking_lot::RwLock;
use sha2::{Digest, Sha256};
use subtle::ConstantTimeEq;

use super::problem::Problem;
use upm_core::coded_enum;

/// Shortest token, characters.
const SHORTEST_TOKEN: usize = 32;

coded_enum! {
    /// Scope of a token, with its name in OpenAPI document and log; the larger one includes the smaller.
    #[derive(PartialOrd, Ord)]
    pub enum Scope {
        /// Read, and stop a plate in an emergency.
        Read = "read",
        /// Submit, cancel, reset, resume.
        Operate = "operate",
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

#[derive(PartialEq)]
struct Token {
    digest: [u8; 32],
    scope: Scope,
    name: String,
}

/// The accepted bearer tokens. Without any, every client that can connect may do everything, so this is for loopback
/// alone.
#[derive(Default)]
pub struct Tokens(RwLock<Vec<Token>>);

impl fmt::Debug for Tokens {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_list().entries(self.0.read().iter().map(|token| (&token.name, token.scope))).finish()
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
        self.0.get_mut().push(Token { digest: Sha256::digest(secret).into(), scope, name: name.to_owned() });
        Ok(())
    }

    /// True when no token is required.
    pub fn is_empty(&self) -> bool {
        self.0.read().is_empty()
    }

    /// Accepts the tokens of `new` alone from now on; true if they differ from those before.
    pub(crate) fn replace(&self, new: Self) -> bool {
        let new = new.0.into_inner();
        let differs = *self.0.read() != new;
        if differs {
            *self.0.write() = new;
        }
        differs
    }

    /// The caller's name, if its token grants `needed`.
    pub(crate) fn admit(&self, headers: &HeaderMap, needed: Scope) -> Result<String, Problem> {
        if self.is_empty() {
            return Ok("local".to_owned());
        }
        let refused = |kind, detail: &str| {
            Problem::new(kind, detail).with_header(WWW_AUTHENTICATE, HeaderValue::from_static("Bearer realm=\"upm\""))
        };
        let secret =
            bearer(headers).ok_or_else(|| refused(StatusCode::UNAUTHORIZED, "send `Authorization: Bearer TOKEN`"))?;
        let digest: [u8; 32] = Sha256::digest(secret).into();
        // digests are compared in constant time: how long it takes tells nothing of a token
        let tokens = self.0.read();
        let token = tokens.iter().find(|token| token.digest.ct_eq(&digest).into());
        let unknown = || refused(StatusCode::UNAUTHORIZED, "the token is not one of this daemon's");
        let token = token.ok_or_else(unknown)?;
        if token.scope < needed {
            let detail = format!("the token may {}, this needs one that may {}", token.scope.code(), needed.code());
            return Err(refused(StatusCode::FORBIDDEN, &detail));
        }
        Ok(token.name.clone())
    }
}

/// The text after `Bearer` in the Authorization header.
fn bearer(headers: &HeaderMap) -> Option<&[u8]> {
    let (scheme, token) = headers.get(AUTHORIZATION)?.as_bytes().split_at_checked("bearer ".len())?;
    scheme.eq_ignore_ascii_case(b"bearer ").then(|| token.trim_ascii())
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
        tokens().admit(&headers, needed).map_err(|problem| problem.status().as_u16())
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

use std::net::{IpAddr, SocketAddr};
use std::sync::Arc;

use axum::extract::{Request, State};
use axum::http::header::{CACHE_CONTROL, HOST, HeaderName, ORIGIN, REFERRER_POLICY, X_CONTENT_TYPE_OPTIONS};
use axum::http::{HeaderMap, HeaderValue, Method};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

use super::{Problem, ProblemKind};

static SEC_FETCH_SITE: HeaderName = HeaderName::from_static("sec-fetch-site");
static SEC_FETCH_MODE: HeaderName = HeaderName::from_static("sec-fetch-mode");
static SEC_FETCH_DEST: HeaderName = HeaderName::from_static("sec-fetch-dest");
static RESOURCE_POLICY: HeaderName = HeaderName::from_static("cross-origin-resource-policy");

/// The names under which the daemon may be called. A page of another site whose name resolves to this machine (DNS
/// rebinding) sends that name as Host, and is refused.
#[derive(Clone, Debug)]
pub struct AllowedHosts {
    listen: IpAddr,
    names: Vec<String>,
}

impl AllowedHosts {
    /// The listening address, loopback, and the `names` of the configuration (without ports). When listening on all
    /// addresses, any address is accepted as well: rebinding needs a name.
    pub fn new(listen: SocketAddr, names: &[String]) -> Self {
        let names = names.iter().map(|name| name.trim_end_matches('.').to_ascii_lowercase()).collect();
        Self { listen: listen.ip().to_canonical(), names }
    }

    fn knows(&self, authority: &Authority) -> bool {
        match &authority.host {
            Host::Address(address) => {
                self.listen.is_unspecified()
                    || *address == self.listen
                    || *address == IpAddr::from([127, 0, 0, 1])
                    || *address == IpAddr::from([0, 0, 0, 0, 0, 0, 0, 1])
                    || self.names_hold(&address.to_string())
            }
            Host::Name(name) => name == "localhost" || self.names_hold(name),
        }
    }

    fn names_hold(&self, name: &str) -> bool {
        self.names.iter().any(|known| known == name)
    }

    /// Checks the host that a request names, its origin and its site.
    pub(super) fn check(&self, request: &Request) -> Result<(), Problem> {
        let host = self.check_host(request)?;
        check_origin(request.headers(), &host)?;
        check_site(request)
    }

    fn check_host(&self, request: &Request) -> Result<Authority, Problem> {
        let malformed = |detail: &str| Problem::new(ProblemKind::Malformed, detail);
        let mut values = request.headers().get_all(HOST).iter();
        let (Some(value), None) = (values.next(), values.next()) else {
            return Err(malformed("exactly one Host header is needed"));
        };
        let host = value.to_str().ok().and_then(Authority::parse);
        let host =
            host.ok_or_else(|| malformed("the Host header is not a name or an address, with or without port"))?;
        let mut asked = vec![host];
        if let Some(absolute) = request.uri().authority() {
            let absolute = Authority::parse(absolute.as_str());
            asked.insert(0, absolute.ok_or_else(|| malformed("the address asked for has no plain host"))?);
        }
        if !asked.iter().all(|authority| self.knows(authority)) {
            let detail = "the daemon is not known by the name in Host; `hosts` in its configuration adds names";
            return Err(Problem::new(ProblemKind::Forbidden, detail));
        }
        Ok(asked.swap_remove(0))
    }
}

/// Checks the Origin header, which pages send with every request that is not plainly harmless: it must name the host
/// and port of the request. Other services may serve pages under the same name on other ports.
fn check_origin(headers: &HeaderMap, host: &Authority) -> Result<(), Problem> {
    for value in headers.get_all(ORIGIN) {
        let origin = value.to_str().ok().and_then(RequestOrigin::parse);
        let ours = origin.is_some_and(|RequestOrigin { authority, default_port }| {
            let port = |of: &Authority| of.port.unwrap_or(default_port);
            authority.host == host.host && port(&authority) == port(host)
        });
        if !ours {
            return Err(Problem::new(ProblemKind::Forbidden, "pages of other origins may not call the daemon"));
        }
    }
    Ok(())
}

/// Checks the site that browsers report for every request, reads included. Another site may only link to the operator
/// page.
fn check_site(request: &Request) -> Result<(), Problem> {
    let headers = request.headers();
    let is = |name: &HeaderName, wanted: &str| headers.get(name).is_some_and(|value| value == wanted);
    let own = headers.get_all(&SEC_FETCH_SITE).iter().all(|value| value == "same-origin" || value == "none");
    let link = request.method() == Method::GET
        && request.uri().path() == "/"
        && is(&SEC_FETCH_MODE, "navigate")
        && is(&SEC_FETCH_DEST, "document");
    if own || link {
        return Ok(());
    }
    Err(Problem::new(ProblemKind::Forbidden, "pages of other sites may not call the daemon"))
}

#[derive(Clone, Debug, PartialEq, Eq)]
enum Host {
    Address(IpAddr),
    Name(String),
}

/// `host[:port]`, the host in lower case and without a trailing dot.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Authority {
    host: Host,
    port: Option<u16>,
}

impl Authority {
    fn parse(text: &str) -> Option<Self> {
        let (host, port) = match text.strip_prefix('[') {
            Some(rest) => {
                let (address, port) = rest.split_once(']')?;
                (Host::Address(IpAddr::V6(address.parse().ok()?).to_canonical()), port)
            }
            None => {
                let (name, port) = text.split_at(text.find(':').unwrap_or(text.len()));
                (Self::host(name)?, port)
            }
        };
        let port = match port.strip_prefix(':') {
            Some(digits) if digits.bytes().all(|b| b.is_ascii_digit()) => Some(digits.parse().ok()?),
            Some(_) => return None,
            None if port.is_empty() => None,
            None => return None,
        };
        Some(Self { host, port })
    }

    fn host(name: &str) -> Option<Host> {
        if let Ok(address) = name.parse() {
            return Some(Host::Address(IpAddr::V4(address)));
        }
        let name = name.strip_suffix('.').unwrap_or(name);
        let plain = |b: u8| b.is_ascii_alphanumeric() || b"-._".contains(&b);
        (!name.is_empty() && name.bytes().all(plain)).then(|| Host::Name(name.to_ascii_lowercase()))
    }
}

struct RequestOrigin {
    authority: Authority,
    default_port: u16,
}

impl RequestOrigin {
    fn parse(text: &str) -> Option<Self> {
        let (authority, default_port) = match text.strip_prefix("http://") {
            Some(rest) => (rest, 80),
            None => (text.strip_prefix("https://")?, 443),
        };
        Some(Self { authority: Authority::parse(authority)?, default_port })
    }
}

/// The layer that refuses requests by [`AllowedHosts`], and forbids every answer to be sniffed, cached or embedded.
pub async fn guard(State(hosts): State<Arc<AllowedHosts>>, request: Request, next: Next) -> Response {
    let mut response = match hosts.check(&request) {
        Ok(()) => next.run(request).await,
        Err(problem) => problem.into_response(),
    };
    let headers = response.headers_mut();
    headers.insert(X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff"));
    headers.insert(REFERRER_POLICY, HeaderValue::from_static("no-referrer"));
    headers.insert(RESOURCE_POLICY.clone(), HeaderValue::from_static("same-origin"));
    headers.entry(CACHE_CONTROL).or_insert(HeaderValue::from_static("no-store"));
    response
}

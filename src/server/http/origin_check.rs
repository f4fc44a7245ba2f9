use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr};
use std::sync::Arc;

use axum::extract::{Request, State};
use axum::http::header::{CACHE_CONTROL, HOST, ORIGIN, REFERRER_POLICY, X_CONTENT_TYPE_OPTIONS};
use axum::http::{HeaderMap, HeaderValue, Method, StatusCode};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

use super::problem::Problem;

/// The names under which the daemon may be called. A page of another site whose name resolves to this machine (DNS
/// rebinding) sends that name as Host, and is refused.
#[derive(Clone, Debug)]
pub struct AllowedHosts {
    listen: IpAddr,
    names: Vec<String>,
    page_port: Option<u16>,
    /// The page's address without its last slash.
    pub base_path: String,
}

impl AllowedHosts {
    /// The listening address, loopback, and the `names` of the configuration (without ports). When listening on all
    /// addresses, any address is accepted as well: rebinding needs a name.
    pub fn new(listen: SocketAddr, names: &[String]) -> Self {
        let names = names.iter().map(|name| name.trim_end_matches('.').to_ascii_lowercase()).collect();
        Self { listen: listen.ip().to_canonical(), names, page_port: None, base_path: String::new() }
    }

    /// Admits the operator page that the daemon serves at `page`, too: on another port, it is of another origin.
    pub fn with_page(mut self, page: SocketAddr) -> Self {
        self.names.push(page.ip().to_canonical().to_string());
        Self { page_port: Some(page.port()), ..self }
    }

    fn knows(&self, host: &str) -> bool {
        let loopback = [IpAddr::from(Ipv4Addr::LOCALHOST), IpAddr::from(Ipv6Addr::LOCALHOST)];
        let is_own = match host.parse() {
            Ok(address) => self.listen.is_unspecified() || self.listen == address || loopback.contains(&address),
            Err(_) => host == "localhost",
        };
        is_own || self.names.iter().any(|name| name == host)
    }

    /// Checks the host that a request names, its origin and its site.
    pub(super) fn check(&self, request: &Request) -> Result<(), Problem> {
        let host = self.check_host(request)?;
        self.check_origin(request.headers(), &host)?;
        self.check_site(request)
    }

    fn check_host(&self, request: &Request) -> Result<Authority, Problem> {
        let malformed = |detail: &str| Problem::new(StatusCode::BAD_REQUEST, detail);
        let mut values = request.headers().get_all(HOST).iter();
        let (Some(value), None) = (values.next(), values.next()) else {
            return Err(malformed("exactly one Host header is needed"));
        };
        let host = value.to_str().ok().and_then(Authority::parse);
        let host =
            host.ok_or_else(|| malformed("the Host header is not a name or an address, with or without port"))?;
        let absolute = request.uri().authority().map(|authority| Authority::parse(authority.as_str()));
        let absolute = absolute.unwrap_or_else(|| Some(host.clone()));
        let absolute = absolute.ok_or_else(|| malformed("the address asked for has no plain host"))?;
        if ![&host, &absolute].iter().all(|authority| self.knows(&authority.host)) {
            let detail = "the daemon is not known by the name in Host; `hosts` in its configuration adds names";
            return Err(Problem::new(StatusCode::FORBIDDEN, detail));
        }
        Ok(absolute)
    }

    /// Checks the Origin header, which pages send with every request that is not plainly harmless: it must name the
    /// host and port of the request, or the operator page. Other services may serve pages under the same name on other
    /// ports.
    fn check_origin(&self, headers: &HeaderMap, host: &Authority) -> Result<(), Problem> {
        let is_ours = |value: &HeaderValue| {
            let (authority, default_port) = origin(value.to_str().ok()?)?;
            let port = authority.port.unwrap_or(default_port);
            let is_same = authority.host == host.host && port == host.port.unwrap_or(default_port);
            (is_same || (self.page_port == Some(port) && self.knows(&authority.host))).then_some(())
        };
        if headers.get_all(ORIGIN).iter().all(|value| is_ours(value).is_some()) {
            return Ok(());
        }
        Err(Problem::new(StatusCode::FORBIDDEN, "pages of other origins may not call the daemon"))
    }

    /// Checks the site that browsers report for every request, reads included. Another site may only link to the
    /// operator page. To the listener beside it, that page is another site, which its origin has told already.
    fn check_site(&self, request: &Request) -> Result<(), Problem> {
        let headers = request.headers();
        let is = |name: &str, wanted: &str| headers.get(name).is_some_and(|value| value == wanted);
        let own = headers.get_all("sec-fetch-site").iter().all(|value| value == "same-origin" || value == "none");
        let page = self.page_port.is_some() && headers.contains_key(ORIGIN);
        let link = request.method() == Method::GET
            && (request.uri().path().ends_with('/') || request.uri().path() == self.base_path)
            && is("sec-fetch-mode", "navigate")
            && is("sec-fetch-dest", "document");
        if own || page || link {
            return Ok(());
        }
        Err(Problem::new(StatusCode::FORBIDDEN, "pages of other sites may not call the daemon"))
    }
}

/// `host[:port]`: a name in lower case and without a trailing dot, or an address in its canonical form.
#[derive(Clone, Debug)]
struct Authority {
    host: String,
    port: Option<u16>,
}

impl Authority {
    fn parse(text: &str) -> Option<Self> {
        let (host, port) = match text.strip_prefix('[') {
            Some(rest) => {
                let (address, port) = rest.split_once(']')?;
                (IpAddr::V6(address.parse().ok()?).to_canonical().to_string(), port)
            }
            None => {
                let (name, port) = text.split_at(text.find(':').unwrap_or(text.len()));
                let name = name.strip_suffix('.').unwrap_or(name);
                let is_plain = |b: u8| b.is_ascii_alphanumeric() || b"-._".contains(&b);
                let is_name = !name.is_empty() && name.bytes().all(is_plain);
                (is_name.then(|| name.to_ascii_lowercase())?, port)
            }
        };
        let port = match port.strip_prefix(':') {
            Some(digits) if digits.bytes().all(|b| b.is_ascii_digit()) => Some(digits.parse().ok()?),
            None if port.is_empty() => None,
            _ => return None,
        };
        Some(Self { host, port })
    }
}

/// Host and port of an origin, with the usual port of its scheme.
fn origin(text: &str) -> Option<(Authority, u16)> {
    let plain = text.strip_prefix("http://").map(|rest| (rest, 80));
    let (rest, default_port) = plain.or_else(|| Some((text.strip_prefix("https://")?, 443)))?;
    Some((Authority::parse(rest)?, default_port))
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
    headers.insert("cross-origin-resource-policy", HeaderValue::from_static("same-origin"));
    headers.entry(CACHE_CONTROL).or_insert(HeaderValue::from_static("no-store"));
    response
}

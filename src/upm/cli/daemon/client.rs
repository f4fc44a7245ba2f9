mod refusal;
#[cfg(test)]
pub(super) mod testing;
#[cfg(test)]
mod tests;

use std::fs::File;
use std::io::Read;
use std::path::Path;
use std::time::Duration;

use serde::de::DeserializeOwned;
use ureq::http::request::Builder;
use ureq::http::{Request, Response, Uri, header};
use ureq::{Agent, Body};

use crate::cli::client_args::DaemonArgs;
use crate::cli::output::Failure;
use upm_runner::config::is_plain_name;
use upm_server::api::JobsPage;

pub(super) use refusal::{ClientRefusal, on_one_line};

const USUAL_URL: &str = "http://127.0.0.1:8750";
const JSON: &str = "application/json";

/// Largest response that is read, bytes; a page of the longest jobs with their reports is far smaller.
const MOST_ANSWER_BYTES: u64 = 64 << 20;

/// Largest page of jobs that the daemon returns.
const PAGE_OF_JOBS: u32 = 200;

/// Largest token file that is read, bytes.
const MOST_TOKEN_BYTES: u64 = 4096;

/// Timeouts of a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Timeouts {
    /// For usual requests: the daemon checks a job before it answers, and may have other jobs to check first.
    Usual,
    /// For an emergency stop: a short wait, then another attempt.
    Stop,
    /// For event streams, which have no end; a heartbeat comes at least every 5 s.
    Stream,
}

impl Timeouts {
    /// An agent that opens a new connection for every request, straight to the daemon: an emergency stop waits for no
    /// other request and for no proxy.
    fn agent(self) -> Agent {
        let config = Agent::config_builder()
            .http_status_as_error(false)
            .max_redirects(0)
            .max_idle_connections(0)
            .proxy(None)
            .user_agent(concat!("upm/", env!("CARGO_PKG_VERSION")));
        let ms = |ms| Some(Duration::from_millis(ms));
        let config = match self {
            Self::Usual => config.timeout_connect(ms(5_000)).timeout_global(ms(60_000)),
            Self::Stop => config.timeout_connect(ms(1_000)).timeout_global(ms(1_500)),
            Self::Stream => {
                config.timeout_connect(ms(5_000)).timeout_recv_response(ms(15_000)).timeout_per_read(ms(15_000))
            }
        };
        config.build().new_agent()
    }
}

/// Client of a daemon's HTTP API.
#[derive(Clone)]
pub(super) struct Client {
    base: String,
    bearer: Option<String>,
    timeouts: Timeouts,
}

impl Client {
    /// Client of the daemon that the arguments, else the environment, name.
    pub fn new(args: &DaemonArgs) -> Result<Self, Failure> {
        let client = Self::at(&url_of(args))?;
        let file = args.token_file.clone().or_else(|| Some(std::env::var_os("UPM_TOKEN_FILE")?.into()));
        let bearer = file.map(|file| bearer_of(&file)).transpose()?;
        Ok(Self { bearer, ..client })
    }

    /// As [`Self::new`], with the short timeouts of a stop. A token that cannot be read is only reported: an emergency
    /// stop may not need it.
    pub fn for_stop(args: &DaemonArgs) -> Result<Self, Failure> {
        let client = Self::new(args).or_else(|failure| {
            failure.report();
            Self::at(&url_of(args))
        })?;
        Ok(Self { timeouts: Timeouts::Stop, ..client })
    }

    /// Client of the daemon at `url`, without a token.
    pub fn at(url: &str) -> Result<Self, Failure> {
        let base = url.trim_end_matches('/');
        let uri = base.parse::<Uri>().ok();
        let is_http =
            uri.is_some_and(|uri| uri.scheme_str() == Some("http") && uri.host().is_some_and(|h| !h.is_empty()));
        let is_plain = base.bytes().all(|b| b.is_ascii_graphic()) && !base.contains(['?', '#', '@']);
        if !(is_http && is_plain) {
            return Err(Failure::bad_input(format!("--url: expected http://HOST:PORT, found {url:?}")));
        }
        Ok(Self { base: base.to_owned(), bearer: None, timeouts: Timeouts::Usual })
    }

    /// Client of the server at `url`, with the same token and timeouts.
    pub fn elsewhere(&self, url: &str) -> Result<Self, Failure> {
        Ok(Self { bearer: self.bearer.clone(), timeouts: self.timeouts, ..Self::at(url)? })
    }

    /// GET of the value at `path`.
    pub fn get<T: DeserializeOwned>(&self, path: &str) -> Result<T, ClientRefusal> {
        self.read(self.send(Request::get(self.url(path)), "", self.timeouts)?)
    }

    /// POST to `path`, under an idempotency key if one is given; an empty `json` sends no body.
    pub fn post<T: DeserializeOwned>(&self, path: &str, json: &str, key: Option<&str>) -> Result<T, ClientRefusal> {
        let request = Request::post(self.url(path));
        let request = key.into_iter().fold(request, |request, key| request.header("Idempotency-Key", key));
        self.read(self.send(request, json, self.timeouts)?)
    }

    fn url(&self, path: &str) -> String {
        format!("{}{path}", self.base)
    }

    /// The `most` newest jobs, fetched page by page.
    pub fn jobs(&self, state: Option<&str>, most: u32) -> Result<JobsPage, ClientRefusal> {
        let mut all = JobsPage::default();
        loop {
            let left = most - u32::try_from(all.jobs.len()).unwrap_or(most);
            let state = state.map(|state| format!("&state={state}")).unwrap_or_default();
            let cursor = all.next.iter().map(|cursor| format!("&cursor={cursor}")).collect::<String>();
            let page: JobsPage = self.get(&format!("/v1/jobs?limit={}{state}{cursor}", left.min(PAGE_OF_JOBS)))?;
            let is_last = page.next.is_none() || page.jobs.is_empty() || page.next == all.next;
            all.jobs.extend(page.jobs);
            all.next = page.next;
            if is_last || all.jobs.len() as u64 >= u64::from(most) {
                return Ok(all);
            }
        }
    }

    /// Stream of the events at `path`, from the one after `after` on.
    pub fn stream(&self, path: &str, after: Option<u64>) -> Result<Box<dyn Read + Send>, ClientRefusal> {
        let request = Request::get(self.url(path));
        let request = after.into_iter().fold(request, |request, after| request.header("Last-Event-ID", after));
        let response = self.send(request, "", Timeouts::Stream)?;
        Ok(Box::new(response.into_body().into_reader()))
    }

    /// Sends a request; an error status is returned as a refusal.
    fn send(&self, mut request: Builder, body: &str, timeouts: Timeouts) -> Result<Response<Body>, ClientRefusal> {
        if let Some(bearer) = &self.bearer {
            request = request.header(header::AUTHORIZATION, bearer);
        }
        if !body.is_empty() {
            request = request.header(header::CONTENT_TYPE, JSON);
        }
        let lost = |error| ClientRefusal::lost(&self.base, error);
        let response = request.body(body.to_owned()).map_err(ureq::Error::from).and_then(|r| timeouts.agent().run(r));
        let mut response = response.map_err(lost)?;
        if response.status().is_success() {
            return Ok(response);
        }
        let bytes = self.bytes(&mut response).unwrap_or_default();
        Err(ClientRefusal::problem(&self.base, response.status().as_u16(), response.headers(), &bytes))
    }

    fn read<T: DeserializeOwned>(&self, mut response: Response<Body>) -> Result<T, ClientRefusal> {
        let bytes = self.bytes(&mut response)?;
        let base = &self.base;
        let wrong = |error: String| format!("the answer of {base} cannot be understood: {}", on_one_line(&error));
        serde_json::from_slice(&bytes).map_err(|error| ClientRefusal::Lost(wrong(error.to_string())))
    }

    fn bytes(&self, response: &mut Response<Body>) -> Result<Vec<u8>, ClientRefusal> {
        let body = response.body_mut().with_config().limit(MOST_ANSWER_BYTES);
        body.read_to_vec().map_err(|error| ClientRefusal::lost(&self.base, error))
    }
}

/// Address of the daemon that the arguments, else the environment, name.
pub(super) fn url_of(args: &DaemonArgs) -> String {
    args.url.clone().or_else(|| std::env::var("UPM_URL").ok()).unwrap_or_else(|| USUAL_URL.to_owned())
}

/// Value of the `Authorization` header with the token in `file`.
fn bearer_of(file: &Path) -> Result<String, Failure> {
    let mut text = String::new();
    let read = File::open(file).and_then(|open| open.take(MOST_TOKEN_BYTES).read_to_string(&mut text));
    read.map_err(|error| Failure::read_failed(file, &error))?;
    let token = text.trim();
    if token.is_empty() || !token.bytes().all(|b| b.is_ascii_graphic()) {
        let expected = "expected a token, one word of visible ASCII characters";
        return Err(Failure::bad_input(format!("{}: {expected}", file.display())));
    }
    Ok(format!("Bearer {token}"))
}

/// API path of the job with this id.
pub(super) fn job_path(id: &str) -> String {
    format!("/v1/jobs/{id}")
}

/// API path of a plate.
pub(super) fn plate_path(name: &str) -> Result<String, Failure> {
    let wrong = || Failure::bad_input(format!("PLATE: expected a plate, as `upm plates` lists them, found {name:?}"));
    is_plain_name(name).then(|| format!("/v1/plates/{name}")).ok_or_else(wrong)
}

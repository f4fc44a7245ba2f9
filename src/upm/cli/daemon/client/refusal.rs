use std::io::ErrorKind;

use ureq::http::HeaderMap;
use ureq::http::header::RETRY_AFTER;
use ureq::{Error, Timeout};

use crate::cli::output::{BAD_INPUT, Failure};
use upm_runner::config::{Diagnostic, reason};
use upm_server::http::ProblemDocument;

/// Reason why a request to a daemon did not succeed.
#[derive(Debug)]
pub(crate) enum ClientRefusal {
    /// No connection was made: the daemon has not received the request.
    Unreached(String),
    /// The response is missing or incomplete: the request may have been carried out.
    Lost(String),
    /// The daemon refused with a problem document.
    Problem {
        status: u16,
        /// Explanation in a sentence.
        detail: String,
        /// Faults of the document that was sent.
        faults: Vec<Diagnostic>,
        /// Time after which to try again, s.
        retry_after_s: Option<u64>,
    },
}

impl ClientRefusal {
    /// Refusal for a transport error of a request to `base`.
    pub fn lost(base: &str, error: Error) -> Self {
        let unreached = match &error {
            Error::Io(io) => matches!(
                io.kind(),
                ErrorKind::ConnectionRefused
                    | ErrorKind::HostUnreachable
                    | ErrorKind::NetworkUnreachable
                    | ErrorKind::AddrNotAvailable
            ),
            Error::Timeout(phase) => matches!(phase, Timeout::Connect | Timeout::Resolve),
            Error::HostNotFound | Error::ConnectionFailed | Error::BadUri(_) | Error::Http(_) => true,
            _ => false,
        };
        let error = match &error {
            Error::Io(io) => reason(io),
            other => on_one_line(&other.to_string()),
        };
        if unreached {
            Self::Unreached(format!("no daemon answers at {base}: {error} (`upm serve` starts one)"))
        } else {
            Self::Lost(format!("the answer of {base} did not come: {error}"))
        }
    }

    /// Refusal for an error status, with the problem document in `body`.
    pub fn problem(base: &str, status: u16, headers: &HeaderMap, body: &[u8]) -> Self {
        let retry_after_s = headers.get(RETRY_AFTER).and_then(|value| value.to_str().ok()?.parse().ok());
        match serde_json::from_slice::<ProblemDocument>(body) {
            Ok(ProblemDocument { title, detail, faults, .. }) => {
                let detail = if detail.is_empty() { title } else { detail };
                Self::Problem { status, detail: on_one_line(&detail), faults, retry_after_s }
            }
            Err(_) => {
                let detail = format!("{base} answered status {status} without a problem document; is it a upm daemon?");
                Self::Problem { status, detail, faults: Vec::new(), retry_after_s }
            }
        }
    }

    /// True if the same request may succeed a moment later: no daemon reached, an answer lost, a daemon in trouble.
    pub fn may_pass(&self) -> bool {
        match self {
            Self::Unreached(_) | Self::Lost(_) => true,
            Self::Problem { status, .. } => matches!(status, 408 | 429 | 500..),
        }
    }

    pub fn line(&self) -> String {
        match self {
            Self::Unreached(line) | Self::Lost(line) => line.clone(),
            Self::Problem { status, detail, retry_after_s, .. } => {
                let advice = match (status, retry_after_s) {
                    (401, _) => " (--token-file, or UPM_TOKEN_FILE, names the file that holds the token)".to_owned(),
                    (_, Some(seconds)) => format!("; try again in {seconds} s"),
                    _ => String::new(),
                };
                format!("{detail}{advice}")
            }
        }
    }

    /// Failure with one line per fault; `sent` is the name that faults give the document that was sent.
    pub fn into_failure(self, sent: &str) -> Failure {
        let line = self.line();
        match self {
            Self::Problem { status, faults, .. } => {
                let lines: Vec<String> = faults.into_iter().map(|fault| fault.in_file(sent).to_string()).collect();
                let lines = if lines.is_empty() { vec![line] } else { lines };
                let of_the_asker = matches!(status, 400..=404 | 411..=417 | 422 | 431);
                let status = if of_the_asker { BAD_INPUT } else { Failure::failed("").status };
                Failure { status, lines }
            }
            Self::Unreached(_) | Self::Lost(_) => Failure::failed(line),
        }
    }
}

impl From<ClientRefusal> for Failure {
    fn from(refusal: ClientRefusal) -> Self {
        refusal.into_failure("request")
    }
}

/// Text of another program with its control characters escaped: it cannot end a line or control a terminal.
pub(crate) fn on_one_line(text: &str) -> String {
    let shown = |c: char| if c.is_control() { c.escape_default().collect() } else { c.to_string() };
    text.chars().map(shown).collect()
}

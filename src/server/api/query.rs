use crate::http::{Problem, ProblemKind};

use crate::states::JobState;
use upm_core::job::Pace;

/// Default and greatest number of jobs on a page.
const USUAL_LIMIT: usize = 50;
const MOST_LIMIT: usize = 200;

/// Selection of jobs to list, newest first.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct JobsQuery {
    /// Only jobs in this state.
    pub state: Option<JobState>,
    /// Most jobs in the answer, 1 to 200.
    pub limit: usize,
    /// Only jobs older than the one with this id, which need not exist any more.
    pub cursor: Option<String>,
}

impl JobsQuery {
    pub(super) fn of(query: &QueryParams) -> Result<Self, Problem> {
        let state = query.one_of("state", &JobState::ALL.map(|state| (state.code(), state)))?;
        let limit = match query.get("limit") {
            None => USUAL_LIMIT,
            Some(text) => text
                .parse()
                .ok()
                .filter(|limit| (1..=MOST_LIMIT).contains(limit) && text.bytes().all(|b| b.is_ascii_digit()))
                .ok_or_else(|| fault("limit", text, "1 to 200"))?,
        };
        let cursor = match query.get("cursor") {
            Some(text) if !is_job_id(text) => return Err(fault("cursor", text, "`next` of an earlier page")),
            cursor => cursor.map(str::to_owned),
        };
        Ok(Self { state, limit, cursor })
    }
}

/// True for a possible job id: 32 lower-case hex digits, so nothing that has a meaning in a path.
pub(super) fn is_job_id(text: &str) -> bool {
    text.len() == 32 && text.bytes().all(|b| b.is_ascii_digit() || (b'a'..=b'f').contains(&b))
}

/// The query of a request: each name at most once, and only names that the operation knows.
#[derive(Clone, Debug, Default)]
pub(super) struct QueryParams(Vec<(String, String)>);

impl QueryParams {
    /// `known` are the names that the operation takes; if it takes none, its query is ignored.
    pub fn new(pairs: Vec<(String, String)>, known: &[&str]) -> Result<Self, Problem> {
        if known.is_empty() {
            return Ok(Self::default());
        }
        for (i, (name, _)) in pairs.iter().enumerate() {
            if !known.contains(&name.as_str()) {
                return Err(fault("query", name, &known.join(", ")));
            }
            if pairs.iter().take(i).any(|(earlier, _)| earlier == name) {
                return Err(fault(name, "the name twice", "once"));
            }
        }
        Ok(Self(pairs))
    }

    fn get(&self, wanted: &str) -> Option<&str> {
        self.0.iter().find(|(name, _)| name == wanted).map(|(_, value)| value.as_str())
    }

    fn one_of<T: Copy>(&self, name: &str, choices: &[(&str, T)]) -> Result<Option<T>, Problem> {
        let Some(text) = self.get(name) else { return Ok(None) };
        let allowed = || choices.iter().map(|(name, _)| *name).collect::<Vec<_>>().join(", ");
        let chosen = choices.iter().find(|(choice, _)| *choice == text);
        chosen.map(|(_, value)| Some(*value)).ok_or_else(|| fault(name, text, &allowed()))
    }

    pub fn pace(&self) -> Result<Option<Pace>, Problem> {
        self.one_of("pace", &Pace::ALL.map(|pace| (pace.code(), pace)))
    }
}

fn fault(path: &str, found: &str, allowed: &str) -> Problem {
    let found: String = found.chars().take(60).collect();
    Problem::new(ProblemKind::Malformed, "1 fault in the query").with_fault(path, format!("{found:?}"), allowed)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn query(pairs: &[(&str, &str)]) -> Result<JobsQuery, Problem> {
        let pairs = pairs.iter().map(|(name, value)| (name.to_string(), value.to_string())).collect();
        JobsQuery::of(&QueryParams::new(pairs, &["state", "limit", "cursor"])?)
    }

    #[test]
    fn valid_query_is_parsed() {
        let id = "0".repeat(32);
        assert_eq!(query(&[]), Ok(JobsQuery { state: None, limit: 50, cursor: None }));
        let asked = query(&[("limit", "200"), ("state", "interrupted"), ("cursor", &id)]);
        assert_eq!(asked, Ok(JobsQuery { state: Some(JobState::Interrupted), limit: 200, cursor: Some(id) }));
    }

    #[test]
    fn invalid_query_is_rejected() {
        let long = "0".repeat(33);
        let upper = "A".repeat(32);
        for (name, value) in [
            ("limit", "0"),
            ("limit", "201"),
            ("limit", "-1"),
            ("limit", "+5"),
            ("limit", "ten"),
            ("limit", ""),
            ("limit", "99999999999999999999"),
            ("state", "Queued"),
            ("state", ""),
            ("cursor", ""),
            ("cursor", "../../../../../../../etc/passwd0"),
            ("cursor", &long),
            ("cursor", &upper),
            ("sort", "name"),
        ] {
            let problem = query(&[(name, value)]).unwrap_err();
            assert_eq!(problem.kind(), ProblemKind::Malformed, "{name}={value}");
        }
        assert!(query(&[("limit", "5"), ("limit", "5")]).is_err());
    }
}

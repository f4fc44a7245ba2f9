use super::client::Client;
use crate::cli::output::Failure;
use upm_server::service::JobsPage;

/// Largest page of jobs that the daemon returns.
const PAGE: u32 = 200;

/// The `most` newest jobs, fetched page by page.
pub(super) fn list(client: &Client, state: Option<&str>, most: u32) -> Result<JobsPage, Failure> {
    let mut all = JobsPage::default();
    loop {
        let left = most - u32::try_from(all.jobs.len()).unwrap_or(most);
        let state = state.map(|state| format!("&state={state}")).unwrap_or_default();
        let cursor = all.next.iter().map(|cursor| format!("&cursor={cursor}")).collect::<String>();
        let page: JobsPage = client.get(&format!("/v1/jobs?limit={}{state}{cursor}", left.min(PAGE)))?;
        let is_last = page.next.is_none() || page.jobs.is_empty() || page.next == all.next;
        all.jobs.extend(page.jobs);
        all.next = page.next;
        if is_last || all.jobs.len() as u64 >= u64::from(most) {
            return Ok(all);
        }
    }
}

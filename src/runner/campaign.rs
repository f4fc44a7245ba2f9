//! Campaigns: runs of a job in which values are drawn by seed or take several values in turn.
//!
//! A [`Campaign`] is read from a file and makes the job of each of its runs; [`CampaignFolder`] keeps their results, a
//! line a run, and is the only state: runs that it has are not made again. [`Summary`] is of its lines alone, so it is
//! equal for any number of processes that made them. [`Pairs`] compares two campaigns run by run.

mod draws;
mod fault_draws;
mod file;
mod folder;
mod judge;
mod line;
mod numbers;
mod pairs;
mod runs;
mod seeds;
mod statistics;
mod summary;
#[cfg(test)]
mod tests;

pub use file::{Campaign, put};
pub use folder::{CampaignFolder, FolderFacts, MOST_SHARDS};
pub use judge::Judge;
pub use line::{Figures, RunLine};
pub use pairs::{Pairs, PairsVerdict};
pub use runs::{CampaignRunner, Keep};
pub use seeds::Seeds;
pub use statistics::Interval;
pub use summary::{CellSummary, FigureSummary, Summary};

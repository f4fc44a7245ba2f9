//! Replaces the drawing files that a job names by their path data.

use super::job_file::{JobFile, TaskSection};
use super::read::{Origin, exactly_one};
use super::shape_file::{LONGEST_DATA, SvgShape};
use upm_core::document::{Diagnostic, Diagnostics, Path, text_within};
use upm_planning::shapes::path_data_of;

impl JobFile {
    /// The same job with path data in place of its drawing files, and warnings of what is in them beside paths.
    ///
    /// # Errors
    /// Every file that cannot be read or contains no path.
    pub fn with_drawings_written_out(mut self, origin: &Origin) -> Result<(Self, Vec<Diagnostic>), Vec<Diagnostic>> {
        let mut faults = Diagnostics::of(&origin.file);
        let warnings = write_out(&mut self, origin, &mut faults);
        faults.into_result(Some((self, warnings)))
    }
}

/// Writes path data in place of every file that the tasks name, and warns of what is in them beside paths.
pub(super) fn write_out(document: &mut JobFile, origin: &Origin, faults: &mut Diagnostics) -> Vec<Diagnostic> {
    let places: Vec<Path> = document.each_task().into_iter().map(|(at, _)| at).collect();
    let tasks = document.task.iter_mut().chain(document.tasks.iter_mut().flatten());
    let shapes = places.iter().zip(tasks).flat_map(|(at, task)| shapes_of(task, at));
    shapes.filter_map(|(at, svg)| write_out_one(svg, &at.key("svg"), origin, faults)).collect()
}

fn shapes_of<'a>(task: &'a mut TaskSection, at: &Path) -> Vec<(Path, &'a mut SvgShape)> {
    match task {
        TaskSection::Arrange { targets: Some(targets), .. } => {
            targets.svg.iter_mut().map(|svg| (at.key("targets"), svg)).collect()
        }
        TaskSection::Trajectories { paths, .. } => {
            let each = paths.iter_mut().enumerate();
            each.filter_map(|(i, path)| Some((at.key("paths").index(i), path.svg.as_mut()?))).collect()
        }
        TaskSection::PlusSign { .. }
        | TaskSection::Arrange { .. }
        | TaskSection::Sort { .. }
        | TaskSection::Hold { .. } => Vec::new(),
    }
}

fn write_out_one(svg: &mut SvgShape, at: &Path, origin: &Origin, faults: &mut Diagnostics) -> Option<Diagnostic> {
    if !exactly_one(svg, &["file", "d"], at, faults) {
        svg.d = None;
        return None;
    }
    let (named, at) = (svg.file.take()?, at.key("file"));
    let path = origin.named_file(&named, &at, faults)?;
    match text_within(&path, LONGEST_DATA as u64).map(|text| path_data_of(&text)) {
        Err(unread) => faults.append(unread),
        Ok(Err(found)) => faults.push(&at, format!("{} with {found}", path.display()), "an SVG drawing with paths"),
        Ok(Ok((d, _))) if d.len() > LONGEST_DATA => {
            let found = format!("{} with path data of {} bytes", path.display(), d.len());
            faults.push(&at, found, format!("up to {LONGEST_DATA} bytes: a simpler drawing"));
        }
        Ok(Ok((d, others))) => {
            svg.d = Some(d);
            let found = format!("{} with {others}", path.display());
            return (!others.is_empty()).then(|| Diagnostic::new(&origin.file, &at, found, "plain paths"));
        }
    }
    None
}

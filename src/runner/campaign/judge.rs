use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

use serde::Deserialize;

use crate::run::RunError;
use upm_core::document::reason;

/// A process that judges runs: it reads the path of a run folder, a line, and answers with a line of JSON,
/// `{"violations": ["what is wrong"]}`.
#[derive(Debug)]
pub struct Judge {
    child: Child,
    asked: Option<ChildStdin>,
    answers: BufReader<ChildStdout>,
    command: String,
}

#[derive(Deserialize)]
struct Judgement {
    violations: Vec<String>,
}

impl Judge {
    /// Starts `command` in a shell.
    ///
    /// # Errors
    /// A shell that cannot be started.
    pub fn start(command: &str) -> Result<Self, RunError> {
        let mut shell = Command::new("sh");
        // Ctrl-C ends the campaign, which ends its judges
        #[cfg(unix)]
        std::os::unix::process::CommandExt::process_group(&mut shell, 0);
        let started = shell.args(["-c", command]).stdin(Stdio::piped()).stdout(Stdio::piped()).spawn();
        let mut child = started.map_err(|error| RunError::Judge(format!("{command:?}: {}", reason(&error))))?;
        let (asked, answers) = (child.stdin.take(), child.stdout.take());
        let answers = BufReader::new(answers.ok_or_else(|| RunError::Judge(format!("{command:?}: no output")))?);
        Ok(Self { child, asked, answers, command: command.to_owned() })
    }

    /// Violations that it finds in the run in `folder`.
    ///
    /// # Errors
    /// A judge that has ended or answers with anything else.
    pub fn ask(&mut self, folder: &Path) -> Result<Vec<String>, RunError> {
        let mut answer = String::new();
        let asked =
            self.asked.as_mut().map(|asked| writeln!(asked, "{}", folder.display()).and_then(|()| asked.flush()));
        let said = match asked {
            Some(Ok(())) => self.answers.read_line(&mut answer).is_ok_and(|bytes| bytes > 0),
            _ => false,
        };
        let wrong = |found: String| {
            let allowed = r#"expected a line {"violations": [...]} for each run folder"#;
            RunError::Judge(format!("{allowed}, found {:?}: {found}", self.command))
        };
        if !said {
            return Err(wrong("it has ended".into()));
        }
        let judgement: Judgement = serde_json::from_str(&answer).map_err(|error| wrong(error.to_string()))?;
        Ok(judgement.violations)
    }
}

impl Drop for Judge {
    fn drop(&mut self) {
        // it ends with its input
        self.asked = None;
        self.child.wait().ok();
    }
}

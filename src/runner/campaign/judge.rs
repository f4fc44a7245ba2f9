use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, ChildStdout, Command, Stdio};

use serde::Deserialize;

use crate::run::RunError;
use upm_core::document::reason;

/// A process that judges runs: it reads the path of a run folder, a line, and answers with a line of JSON,
/// `{"violations": ["what is wrong"]}`.
#[derive(Debug)]
pub struct Judge {
    child: Child,
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
        let answers = child.stdout.take().ok_or_else(|| RunError::Judge(format!("{command:?}: no output")))?;
        Ok(Self { child, answers: BufReader::new(answers), command: command.to_owned() })
    }

    /// Violations that it finds in the run in `folder`.
    ///
    /// # Errors
    /// A judge that has ended or answers with anything else.
    pub fn ask(&mut self, folder: &Path) -> Result<Vec<String>, RunError> {
        let mut answer = String::new();
        let asked = self.child.stdin.as_mut().map(|asked| writeln!(asked, "{}", folder.display()));
        let is_asked = asked.is_some_and(|asked| asked.is_ok());
        let said = is_asked && self.answers.read_line(&mut answer).is_ok_and(|bytes| bytes > 0);
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
        // waiting closes its input, with which it ends
        self.child.wait().ok();
    }
}

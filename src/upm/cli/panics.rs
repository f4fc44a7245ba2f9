use std::backtrace::{Backtrace, BacktraceStatus};
use std::panic::{self, PanicHookInfo};
use std::thread;

/// Installs a panic hook that logs panics as errors instead of writing to stderr, which could block on its reader.
pub(super) fn install_panic_hook() {
    panic::set_hook(Box::new(note));
}

fn note(panic: &PanicHookInfo<'_>) {
    let thread = thread::current();
    let name = thread.name().unwrap_or("unnamed");
    let place = panic.location().map(ToString::to_string).unwrap_or_default();
    tracing::error!(thread = name, place, "panicked: {}", message(panic));
    let backtrace = Backtrace::capture();
    if backtrace.status() == BacktraceStatus::Captured {
        tracing::error!(thread = name, "that panic's backtrace:\n{backtrace}");
    }
}

/// Message of the panic, on one line.
fn message(panic: &PanicHookInfo<'_>) -> String {
    let payload = panic.payload();
    let text = payload.downcast_ref::<&str>().copied();
    let text = text.or_else(|| payload.downcast_ref::<String>().map(String::as_str));
    text.unwrap_or("something that is no text").lines().collect::<Vec<_>>().join(" | ")
}

#[cfg(test)]
mod tests {
    use std::panic::{catch_unwind, panic_any};

    use super::super::test_buffer::TestBuffer;
    use super::*;

    #[test]
    fn a_panic_is_one_line_of_the_log() {
        let page = TestBuffer::default();
        let writer = page.clone();
        let subscriber = tracing_subscriber::fmt().json().flatten_event(true).with_writer(move || writer.clone());
        let before = panic::take_hook();
        install_panic_hook();
        tracing::subscriber::with_default(subscriber.finish(), || {
            let (plate, two) = ("left", "two\nlines");
            assert!(catch_unwind(|| panic!("as asked")).is_err());
            assert!(catch_unwind(|| panic!("of {plate}: {two}")).is_err());
            assert!(catch_unwind(|| panic_any(7)).is_err());
        });
        panic::set_hook(before);
        let lines = page.lines().into_iter().map(|line| serde_json::from_str(&line).unwrap());
        let is_panic = |line: &serde_json::Value| line["message"].as_str().is_some_and(|it| it.starts_with("panicked"));
        let panics: Vec<serde_json::Value> = lines.filter(is_panic).collect();
        let messages: Vec<&str> = panics.iter().map(|line| line["message"].as_str().unwrap()).collect();
        assert_eq!(
            messages,
            ["panicked: as asked", "panicked: of left: two | lines", "panicked: something that is no text"]
        );
        for line in &panics {
            assert_eq!((&line["level"], line["thread"].as_str()), (&"ERROR".into(), thread::current().name()));
            assert!(line["place"].as_str().unwrap().starts_with(file!()), "{line}");
        }
    }
}

use std::fmt;

use super::StoreFault;
use super::books::Books;

/// A wish to write, together with who waits for it.
pub(super) trait Task: Send {
    /// Does its part of a transaction; again from the start when that was rolled back.
    fn run(&mut self, books: &Books<'_>) -> rusqlite::Result<()>;

    /// Tells how the transaction ended, once.
    fn answer(self: Box<Self>, stored: Result<(), StoreFault>);

    /// True for what must get through on a full disk: how jobs end, who stopped what.
    fn is_vital(&self) -> bool;
}

impl fmt::Debug for dyn Task {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Task")
    }
}

/// A task made of two closures.
struct Wish<T, R, D> {
    run: R,
    done: D,
    made: Option<T>,
    vital: bool,
}

impl<T, R, D> Task for Wish<T, R, D>
where
    T: Send,
    R: FnMut(&Books<'_>) -> rusqlite::Result<T> + Send,
    D: FnOnce(Result<T, StoreFault>) + Send,
{
    fn run(&mut self, books: &Books<'_>) -> rusqlite::Result<()> {
        self.made = Some((self.run)(books)?);
        Ok(())
    }

    fn answer(self: Box<Self>, stored: Result<(), StoreFault>) {
        let Self { done, made, .. } = *self;
        done(stored.and_then(|()| made.ok_or(StoreFault::Closed)));
    }

    fn is_vital(&self) -> bool {
        self.vital
    }
}

/// Runs `run` in a transaction, then `done` with what it made.
pub(super) fn task<T: Send + 'static>(
    vital: bool,
    run: impl FnMut(&Books<'_>) -> rusqlite::Result<T> + Send + 'static,
    done: impl FnOnce(Result<T, StoreFault>) + Send + 'static,
) -> Box<dyn Task> {
    Box::new(Wish { run, done, made: None, vital })
}

use std::sync::Arc;

use tokio::sync::watch;

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Stage {
    Serving,
    Ending,
    Aborting,
}

/// Ends the server, from any thread, without waiting.
#[derive(Clone, Debug)]
pub struct StopSender(Arc<watch::Sender<Stage>>);

impl StopSender {
    /// No new connections; requests under way are answered and streams say good-bye, within a bound.
    pub fn stop(&self) {
        self.advance(Stage::Ending);
    }

    /// Every connection is dropped now.
    pub fn abort(&self) {
        self.advance(Stage::Aborting);
    }

    fn advance(&self, to: Stage) {
        self.0.send_if_modified(|stage| {
            let later = to > *stage;
            *stage = (*stage).max(to);
            later
        });
    }
}

/// Says whether the server is to end. Without any [`StopSender`] left it is.
#[derive(Clone, Debug)]
pub struct StopFlag(watch::Receiver<Stage>);

impl StopFlag {
    /// A flag and what sets it.
    pub fn new() -> (StopSender, Self) {
        let (sender, receiver) = watch::channel(Stage::Serving);
        (StopSender(Arc::new(sender)), Self(receiver))
    }

    /// The server is to end.
    pub fn is_set(&self) -> bool {
        *self.0.borrow() > Stage::Serving || self.0.has_changed().is_err()
    }

    /// Waits until the server is to end.
    pub(in crate::service) async fn stopped(&self) {
        let _ = self.0.clone().wait_for(|stage| *stage >= Stage::Ending).await;
    }

    /// Waits until connections are to be dropped.
    pub(super) async fn aborted(&self) {
        let _ = self.0.clone().wait_for(|stage| *stage >= Stage::Aborting).await;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn stages_go_one_way() {
        let (sender, flag) = StopFlag::new();
        assert!(!flag.is_set());
        sender.clone().abort();
        sender.stop();
        flag.aborted().await;
        assert!(flag.is_set());
    }

    #[tokio::test]
    async fn a_lost_sender_stops() {
        let (sender, flag) = StopFlag::new();
        drop(sender);
        flag.stopped().await;
        assert!(flag.is_set());
    }
}

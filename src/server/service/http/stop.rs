use std::sync::Arc;

use tokio::sync::watch;

/// Ends the server, from any thread, without waiting.
#[derive(Clone, Debug)]
pub struct StopSender(Arc<watch::Sender<bool>>);

impl StopSender {
    /// No new connections; requests under way are answered and streams say good-bye, within a bound.
    pub fn stop(&self) {
        self.0.send_replace(true);
    }
}

/// Says whether the server is to end. Without any [`StopSender`] left it is.
#[derive(Clone, Debug)]
pub struct StopFlag(watch::Receiver<bool>);

impl StopFlag {
    /// A flag and what sets it.
    pub fn new() -> (StopSender, Self) {
        let (sender, receiver) = watch::channel(false);
        (StopSender(Arc::new(sender)), Self(receiver))
    }

    /// Waits until the server is to end.
    pub(in crate::service) async fn stopped(&self) {
        let _ = self.0.clone().wait_for(|stop| *stop).await;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn whoever_stops_first_stops() {
        let (sender, flag) = StopFlag::new();
        sender.clone().stop();
        sender.stop();
        flag.stopped().await;
    }

    #[tokio::test]
    async fn a_lost_sender_stops() {
        let (sender, flag) = StopFlag::new();
        drop(sender);
        flag.stopped().await;
    }
}

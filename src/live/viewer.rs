//! One viewer: it reports when it is ready, gets the newest content that it has not received, and may send commands
//! with the token.

use std::sync::Arc;
use std::time::Duration;

use axum::extract::ws::{CloseFrame, Message, WebSocket};
use serde_json::json;
use tokio::sync::{oneshot, watch};
use tokio::time::{Instant, sleep_until, timeout};

use super::board::{Newest, PERIOD, PLACES, Seat};
use super::request::{Command, Request};
use super::server::{Desk, Reply};

/// A viewer that accepts nothing for this time, or does not answer a ping before the next, is disconnected.
const PATIENCE: Duration = Duration::from_secs(10);
const PING: Duration = Duration::from_secs(20);
/// Largest number of messages from a viewer per second: three times that of the page on a fast display.
const MOST_PER_S: u32 = 400;
/// Close codes of a WebSocket: the server goes away; a message violates the rules.
const AWAY: u16 = 1001;
const RULES: u16 = 1008;

/// Why a viewer's connection ends.
enum End {
    /// It has disconnected, or accepts nothing.
    Gone,
    /// It has sent an invalid message.
    Wrong(&'static str),
    /// The server ends.
    Stopped,
}

struct Viewer {
    socket: WebSocket,
    news: watch::Receiver<Newest>,
    seen: [u64; PLACES],
    /// Whether it is ready for more, though not before `due`.
    ready: bool,
    due: Instant,
    /// Whether it has sent a message since the last ping.
    heard: bool,
    /// Number of messages in this second, and its start.
    said: (u32, Instant),
    desk: Arc<Desk>,
    /// The active command.
    waiting: Option<oneshot::Receiver<Reply>>,
}

/// Serves a viewer until it disconnects or the server ends.
pub(super) async fn serve(socket: WebSocket, seat: Seat, desk: Arc<Desk>, mut stop: watch::Receiver<bool>) {
    let news = seat.listen();
    let (seen, due) = ([0; PLACES], Instant::now());
    let said = (0, due);
    let mut viewer = Viewer { socket, news, seen, ready: false, due, heard: true, said, desk, waiting: None };
    let end = loop {
        if let Err(end) = viewer.turn(&mut stop).await {
            break end;
        }
    };
    let frame = match end {
        End::Gone => return,
        End::Wrong(reason) => CloseFrame { code: RULES, reason: reason.into() },
        End::Stopped => CloseFrame { code: AWAY, reason: "the twin has ended".into() },
    };
    // It may have disconnected meanwhile.
    let _ = timeout(PATIENCE, viewer.socket.send(Message::Close(Some(frame)))).await;
}

impl Viewer {
    /// Waits for the first event, and handles it.
    async fn turn(&mut self, stop: &mut watch::Receiver<bool>) -> Result<(), End> {
        let Self { socket, news, ready, due, waiting, .. } = self;
        let ping = Instant::now() + PING;
        tokio::select! {
            () = stopped(stop) => Err(End::Stopped),
            message = socket.recv() => {
                self.heard = true;
                self.take(message.ok_or(End::Gone)?.map_err(|_| End::Gone)?).await
            }
            reply = answered(waiting) => {
                self.waiting = None;
                self.reply(&reply).await
            }
            more = newer(news, *due), if *ready => {
                if more { self.show().await } else { Err(End::Stopped) }
            }
            () = sleep_until(ping) => {
                if !std::mem::take(&mut self.heard) { return Err(End::Gone); }
                self.send(Message::Ping(Vec::new().into())).await
            }
        }
    }

    async fn take(&mut self, message: Message) -> Result<(), End> {
        let now = Instant::now();
        let (count, since) = self.said;
        self.said = if now - since < Duration::from_secs(1) { (count + 1, since) } else { (1, now) };
        if self.said.0 > MOST_PER_S {
            return Err(End::Wrong("too many requests"));
        }
        match message {
            Message::Text(text) => match Request::parse(&text).map_err(End::Wrong)? {
                Request::Next => {
                    self.ready = true;
                    Ok(())
                }
                Request::Command { token, command } => self.command(&token, command).await,
            },
            Message::Binary(_) => Err(End::Wrong("requests are texts")),
            Message::Ping(_) | Message::Pong(_) => Ok(()),
            Message::Close(_) => Err(End::Gone),
        }
    }

    async fn command(&mut self, token: &str, command: Command) -> Result<(), End> {
        let refusal = if !self.desk.door.is_token(token) {
            "this needs the token: open the address that the node has printed"
        } else if self.waiting.is_some() {
            "the last one is not done yet"
        } else {
            match self.desk.ask(command) {
                Some(reply) => {
                    self.waiting = Some(reply);
                    return Ok(());
                }
                None => "the node is too busy, try again",
            }
        };
        self.reply(&Reply { done: false, message: refusal.to_owned() }).await
    }

    async fn reply(&mut self, reply: &Reply) -> Result<(), End> {
        let text = json!({ "kind": "reply", "done": reply.done, "message": reply.message }).to_string();
        self.send(Message::Text(text.into())).await
    }

    /// Sends the content that it has not received.
    async fn show(&mut self) -> Result<(), End> {
        // deadlines are absolute, so that delays do not accumulate
        (self.ready, self.due) = (false, (self.due + PERIOD).max(Instant::now()));
        let newest = self.news.borrow_and_update().clone();
        for (seen, (version, message)) in self.seen.iter_mut().zip(newest) {
            if std::mem::replace(seen, version) != version
                && let Some(message) = message
            {
                send(&mut self.socket, message).await?;
            }
        }
        Ok(())
    }

    async fn send(&mut self, message: Message) -> Result<(), End> {
        send(&mut self.socket, message).await
    }
}

async fn send(socket: &mut WebSocket, message: Message) -> Result<(), End> {
    match timeout(PATIENCE, socket.send(message)).await {
        Ok(Ok(())) => Ok(()),
        _ => Err(End::Gone),
    }
}

/// Outcome of the active command; waits forever if there is none.
async fn answered(waiting: &mut Option<oneshot::Receiver<Reply>>) -> Reply {
    match waiting {
        None => std::future::pending().await,
        Some(reply) => {
            let gone = || Reply { done: false, message: "the node could not do it, try again".to_owned() };
            reply.await.unwrap_or_else(|_| gone())
        }
    }
}

/// Waits for the end of the server.
async fn stopped(stop: &mut watch::Receiver<bool>) {
    // An error means that the server has ended.
    let _ = stop.wait_for(|stopped| *stopped).await;
}

/// Waits for new content, and at least until `due`; false if there will be none.
async fn newer(news: &mut watch::Receiver<Newest>, due: Instant) -> bool {
    sleep_until(due).await;
    news.changed().await.is_ok()
}

//! The page's thread: accepts connections, serves page and assets, and requests the figures while there is a viewer. A viewer reports when it is
//! ready, gets the newest content that it has not received, and may send commands with the token.

use std::net::{IpAddr, SocketAddr, TcpListener};
use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use axum::extract::ws::{CloseFrame, Message, WebSocket, WebSocketUpgrade};
use axum::extract::{Request as HttpRequest, State};
use axum::http::StatusCode;
use axum::middleware::{Next, from_fn_with_state};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use crossbeam_channel::Sender;
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use serde_json::json;
use tokio::sync::{Semaphore, oneshot, watch};
use tokio::time::{Instant, sleep_until, timeout};

use super::board::{Board, Newest, PERIOD, PLACES, Seat};
use super::door::Door;
use super::error::LiveError;
use super::page;
use super::request::{Command, LONGEST_REQUEST, Request};
use served::{Service, accept, bind};

/// Largest number of simultaneous connections other than viewers.
const CONNECTIONS: usize = 32;
/// Time limit for receiving the head of a request.
const HEAD: Duration = Duration::from_secs(5);
/// Time that viewers get to receive the end of the stream.
const FAREWELL: Duration = Duration::from_millis(200);

/// A viewer's command for the process that runs the twin.
#[derive(Debug)]
pub struct Asked {
    /// What is to be done.
    pub command: Command,
    reply: oneshot::Sender<Reply>,
}

impl Asked {
    /// Reports the outcome.
    pub fn answer(self, done: bool, message: String) {
        // Fails only if the viewer has disconnected.
        let _ = self.reply.send(Reply { done, message });
    }
}

/// Outcome of a command.
#[derive(Debug)]
struct Reply {
    done: bool,
    message: String,
}

/// Queue of commands.
struct Desk {
    door: Door,
    asked: Sender<Asked>,
    /// Notifies the receiver of a command.
    ring: Box<dyn Fn() + Send + Sync>,
}

impl Desk {
    /// Queues a command; `None` if the queue is full.
    fn ask(&self, command: Command) -> Option<oneshot::Receiver<Reply>> {
        let (reply, answer) = oneshot::channel();
        self.asked.try_send(Asked { command, reply }).ok()?;
        (self.ring)();
        Some(answer)
    }
}

#[derive(Clone)]
struct House {
    board: Arc<Board>,
    desk: Arc<Desk>,
    stop: watch::Receiver<bool>,
}

/// A page that is served until this is dropped.
#[derive(Debug)]
pub struct Server {
    url: String,
    token: String,
    _service: Service,
}

impl Server {
    /// Serves `board` at an address and port (0: any that is free). `figures` creates the JSON of the figures, about
    /// 30 times a second while there is a viewer. Commands go to `asked`, and `ring` is called after each.
    ///
    /// # Errors
    /// [`LiveError::Bind`] if the port is in use, [`LiveError::Thread`].
    pub fn start(
        at: (IpAddr, u16),
        board: Arc<Board>,
        figures: impl FnMut() -> String + Send + 'static,
        asked: Sender<Asked>,
        ring: impl Fn() + Send + Sync + 'static,
    ) -> Result<Self, LiveError> {
        let (listener, served) = bind(at).map_err(|(address, source)| LiveError::Bind { address, source })?;
        let door = Door::new(served);
        let (url, token) = (url(served), door.token().to_owned());
        let desk = Arc::new(Desk { door, asked, ring: Box::new(ring) });
        let serve = |stop| serve(listener, House { board, desk, stop }, figures);
        let service = Service::start("page", 2 * FAREWELL, serve).map_err(LiveError::Thread)?;
        Ok(Self { url, token, _service: service })
    }

    /// URL of the page: `http://127.0.0.1:8080/`.
    #[must_use]
    pub fn url(&self) -> &str {
        &self.url
    }

    /// The same with the token, for viewers that may send commands.
    #[must_use]
    pub fn url_with_token(&self) -> String {
        format!("{}#token={}", self.url, self.token)
    }
}

/// If all addresses are served, the URL uses the loopback.
fn url(served: SocketAddr) -> String {
    let host = match served.ip() {
        IpAddr::V4(ip) if ip.is_unspecified() => "127.0.0.1".to_owned(),
        IpAddr::V6(ip) if ip.is_unspecified() => "[::1]".to_owned(),
        IpAddr::V4(ip) => ip.to_string(),
        IpAddr::V6(ip) => format!("[{ip}]"),
    };
    format!("http://{host}:{}/", served.port())
}

async fn serve(listener: TcpListener, house: House, mut figures: impl FnMut() -> String) {
    let mut stop = house.stop.clone();
    let board = Arc::clone(&house.board);
    tokio::select! {
        _ = stop.wait_for(|stopped| *stopped) => {}
        () = connect(listener, house) => {}
        () = board.news.while_watched(PERIOD, || board.figures(figures())) => {}
    }
    let _ = timeout(FAREWELL, board.news.left()).await;
}

async fn connect(listener: TcpListener, house: House) {
    let app = router(house);
    let room = Arc::new(Semaphore::new(CONNECTIONS));
    let take = |stream| {
        // Too many connections: this one is closed.
        let Ok(permit) = Arc::clone(&room).try_acquire_owned() else { return };
        let service = TowerToHyperService::new(app.clone());
        tokio::spawn(async move {
            let mut http = http1::Builder::new();
            http.timer(TokioTimer::new()).header_read_timeout(HEAD).max_buf_size(16 << 10);
            // An error of one connection ends only that one.
            let _ = http.serve_connection(TokioIo::new(stream), service).with_upgrades().await;
            drop(permit);
        });
    };
    accept(listener, take).await;
}

fn router(house: House) -> Router {
    Router::new()
        .route("/", get(page::page))
        .route("/live.css", get(page::style))
        .route("/live.js", get(page::script))
        .route("/stream", get(stream))
        .layer(from_fn_with_state(house.clone(), guarded))
        .with_state(house)
}

/// Every request passes the access control, and every answer has the headers.
async fn guarded(State(house): State<House>, request: HttpRequest, next: Next) -> Response {
    let mut response = match house.desk.door.admits(request.headers()) {
        Ok(()) => next.run(request).await,
        Err(reason) => (StatusCode::FORBIDDEN, reason).into_response(),
    };
    response.headers_mut().extend(page::HEADERS);
    response
}

async fn stream(State(house): State<House>, upgrade: WebSocketUpgrade) -> Response {
    let Some(seat) = Seat::take(&house.board.news) else {
        return (StatusCode::SERVICE_UNAVAILABLE, "as many look as there are seats").into_response();
    };
    let upgrade = upgrade.max_message_size(LONGEST_REQUEST).max_frame_size(LONGEST_REQUEST);
    upgrade.on_upgrade(move |socket| show_to(socket, seat, house.desk, house.stop))
}

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
async fn show_to(socket: WebSocket, seat: Seat, desk: Arc<Desk>, mut stop: watch::Receiver<bool>) {
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

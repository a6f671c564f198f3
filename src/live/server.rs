//! The page's thread: accepts connections, serves page and assets, and requests the figures while there is a viewer.

use std::net::{IpAddr, SocketAddr, TcpListener};
use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use axum::extract::ws::WebSocketUpgrade;
use axum::extract::{Request as HttpRequest, State};
use axum::http::StatusCode;
use axum::middleware::{Next, from_fn_with_state};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use crossbeam_channel::Sender;
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use tokio::sync::{Semaphore, oneshot, watch};
use tokio::time::timeout;

use super::board::{Board, PERIOD, Seat};
use super::door::Door;
use super::error::LiveError;
use super::page;
use super::request::{Command, LONGEST_REQUEST};
use super::viewer;
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
pub(super) struct Reply {
    pub done: bool,
    pub message: String,
}

/// Queue of commands.
pub(super) struct Desk {
    pub door: Door,
    asked: Sender<Asked>,
    /// Notifies the receiver of a command.
    ring: Box<dyn Fn() + Send + Sync>,
}

impl Desk {
    /// Queues a command; `None` if the queue is full.
    pub(crate) fn ask(&self, command: Command) -> Option<oneshot::Receiver<Reply>> {
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
    upgrade.on_upgrade(move |socket| viewer::serve(socket, seat, house.desk, house.stop))
}

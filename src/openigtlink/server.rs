//! The link's thread: takes clients, looks for the newest pose while one is there, sends each what it has not seen.

use std::net::{IpAddr, SocketAddr, TcpListener};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::net::tcp::{OwnedReadHalf, OwnedWriteHalf};
use tokio::sync::watch;
use tokio::time::{MissedTickBehavior, interval, sleep, timeout};

use super::board::{Board, PLACES};
use super::error::LinkError;
use super::message::Instrument;
use ros2_guarded::threads::{join_before, lower_priority, spawn};

/// Time between two looks for the instrument: 100 Hz.
const PERIOD: Duration = Duration::from_millis(10);
/// A client that takes nothing for so long has gone.
const PATIENCE: Duration = Duration::from_secs(10);
/// Most bytes that a client may send within a second: a few requests, all of which are dropped.
const MOST_PER_S: usize = 64 << 10;
/// The thread gets so long to end.
const FAREWELL: Duration = Duration::from_millis(200);

/// A link that is being served, until this is dropped.
#[derive(Debug)]
pub struct Server {
    address: SocketAddr,
    stop: watch::Sender<bool>,
    thread: Option<JoinHandle<()>>,
}

impl Server {
    /// Serves `board` at an address and port (0: any that is free). `instrument` says where the instrument is, a hundred times a second while
    /// somebody is connected; `None` says that nothing is known.
    ///
    /// # Errors
    /// [`LinkError::Bind`] if the port is taken, [`LinkError::Thread`].
    pub fn start(
        (address, port): (IpAddr, u16),
        board: Arc<Board>,
        instrument: impl FnMut() -> Option<Instrument> + Send + 'static,
    ) -> Result<Self, LinkError> {
        let wanted = SocketAddr::new(address, port);
        let bind = |source| LinkError::Bind { address: wanted, source };
        let listener = TcpListener::bind(wanted).map_err(bind)?;
        listener.set_nonblocking(true).map_err(bind)?;
        let address = listener.local_addr().map_err(bind)?;
        let runtime = tokio::runtime::Builder::new_current_thread().enable_io().enable_time().build();
        let runtime = runtime.map_err(|e| LinkError::Thread(e.to_string()))?;
        let (stop, stopped) = watch::channel(false);
        let thread = spawn("openigtlink", move || {
            lower_priority();
            runtime.block_on(serve(listener, board, instrument, stopped));
        });
        let thread = thread.map_err(|e| LinkError::Thread(e.to_string()))?;
        Ok(Self { address, stop, thread: Some(thread) })
    }

    /// Where it is.
    #[must_use]
    pub const fn address(&self) -> SocketAddr {
        self.address
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.stop.send_replace(true);
        if let Some(thread) = self.thread.take() {
            let _ = join_before(thread, Instant::now() + FAREWELL);
        }
    }
}

async fn serve(
    listener: TcpListener,
    board: Arc<Board>,
    instrument: impl FnMut() -> Option<Instrument>,
    mut stop: watch::Receiver<bool>,
) {
    tokio::select! {
        _ = stop.wait_for(|stopped| *stopped) => {}
        () = accept(listener, &board) => {}
        () = look(&board, instrument) => {}
    }
}

/// Puts the instrument on the board while somebody is connected.
async fn look(board: &Board, mut instrument: impl FnMut() -> Option<Instrument>) {
    let mut clients = board.count();
    let mut beat = interval(PERIOD);
    beat.set_missed_tick_behavior(MissedTickBehavior::Skip);
    while clients.wait_for(|n| *n > 0).await.is_ok() {
        beat.tick().await;
        if let Some(at) = instrument() {
            board.instrument(&at);
        }
    }
}

async fn accept(listener: TcpListener, board: &Arc<Board>) {
    let Ok(listener) = tokio::net::TcpListener::from_std(listener) else { return };
    loop {
        match listener.accept().await {
            Ok((stream, _)) => match Seat::take(board) {
                Some(seat) => drop(tokio::spawn(client(stream, seat))),
                // As many as there are seats: the connection is closed.
                None => continue,
            },
            // Out of file descriptors, or the peer has gone: nothing that would be better at once.
            Err(_) => sleep(Duration::from_millis(50)).await,
        }
    }
}

/// A seat on the board, given back when it is dropped.
struct Seat(Arc<Board>);

impl Seat {
    /// If one is free.
    fn take(board: &Arc<Board>) -> Option<Self> {
        board.enter().then(|| Self(Arc::clone(board)))
    }
}

impl Drop for Seat {
    fn drop(&mut self) {
        self.0.leave();
    }
}

async fn client(stream: TcpStream, seat: Seat) {
    // Only a matter of latency.
    let _ = stream.set_nodelay(true);
    let (reading, writing) = stream.into_split();
    tokio::select! {
        () = drain(reading) => {}
        () = show(writing, &seat.0) => {}
    }
}

/// Drops what a client sends, until it goes or sends too much.
async fn drain(mut reading: OwnedReadHalf) {
    let mut bytes = [0; 1024];
    let (mut second, mut count) = (Instant::now(), 0);
    while let Ok(n @ 1..) = reading.read(&mut bytes).await {
        if second.elapsed() >= Duration::from_secs(1) {
            (second, count) = (Instant::now(), 0);
        }
        count += n;
        if count > MOST_PER_S {
            return;
        }
    }
}

/// Sends the newest of what a client has not seen, until it goes.
async fn show(mut writing: OwnedWriteHalf, board: &Board) {
    let mut news = board.listen();
    news.mark_changed();
    let mut seen = [0; PLACES];
    while news.changed().await.is_ok() {
        let newest = news.borrow_and_update().clone();
        for (seen, (version, packet)) in seen.iter_mut().zip(newest) {
            if std::mem::replace(seen, version) != version
                && let Some(packet) = packet
                && !matches!(timeout(PATIENCE, writing.write_all(&packet)).await, Ok(Ok(())))
            {
                return;
            }
        }
    }
}

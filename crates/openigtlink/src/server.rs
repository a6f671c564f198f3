//! The link's thread: accepts clients, reads the newest pose while there is one, and sends each client what it has
//! not received.

use std::net::{IpAddr, SocketAddr, TcpListener};
use std::sync::Arc;
use std::time::{Duration, Instant};

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::net::tcp::{OwnedReadHalf, OwnedWriteHalf};
use tokio::sync::watch;
use tokio::time::timeout;

use crate::board::{Board, PLACES, Seat};
use crate::error::LinkError;
use crate::message::Instrument;
use served::{Service, accept, bind};

/// Period of reading the instrument's pose: 100 Hz.
const PERIOD: Duration = Duration::from_millis(10);
/// A client that accepts nothing for this time is disconnected.
const PATIENCE: Duration = Duration::from_secs(10);
/// Largest number of bytes that a client may send per second: a few requests, all of which are discarded.
const MOST_PER_S: usize = 64 << 10;
/// Time that the thread gets to end.
const FAREWELL: Duration = Duration::from_millis(200);

/// A link that is served until this is dropped.
#[derive(Debug)]
pub struct Server {
    address: SocketAddr,
    _service: Service,
}

impl Server {
    /// Serves `board` at an address and port (0: any that is free). `instrument` returns the instrument's pose, a
    /// hundred times a second while a client is connected; `None` if it is not known.
    ///
    /// # Errors
    /// [`LinkError::Bind`] if the port is in use, [`LinkError::Thread`].
    pub fn start(
        at: (IpAddr, u16),
        board: Arc<Board>,
        instrument: impl FnMut() -> Option<Instrument> + Send + 'static,
    ) -> Result<Self, LinkError> {
        let (listener, address) = bind(at).map_err(|(address, source)| LinkError::Bind { address, source })?;
        let serve = |stop| serve(listener, board, instrument, stop);
        let service = Service::start("openigtlink", FAREWELL, serve).map_err(LinkError::Thread)?;
        Ok(Self { address, _service: service })
    }

    /// Its address.
    #[must_use]
    pub const fn address(&self) -> SocketAddr {
        self.address
    }
}

async fn serve(
    listener: TcpListener,
    board: Arc<Board>,
    mut instrument: impl FnMut() -> Option<Instrument>,
    mut stop: watch::Receiver<bool>,
) {
    let look = || {
        if let Some(at) = instrument() {
            board.instrument(&at);
        }
    };
    // The number of clients is limited; the connection of a further one is closed.
    let take = |stream| {
        if let Some(seat) = Seat::take(&board.news) {
            tokio::spawn(client(stream, seat));
        }
    };
    tokio::select! {
        _ = stop.wait_for(|stopped| *stopped) => {}
        () = accept(listener, take) => {}
        () = board.news.while_watched(PERIOD, look) => {}
    }
}

async fn client(stream: TcpStream, seat: Seat) {
    // A failure affects only the latency.
    let _ = stream.set_nodelay(true);
    let (reading, writing) = stream.into_split();
    tokio::select! {
        () = drain(reading) => {}
        () = show(writing, &seat) => {}
    }
}

/// Discards what a client sends, until it disconnects or sends too much.
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

/// Sends the newest content that a client has not received, until it disconnects.
async fn show(mut writing: OwnedWriteHalf, seat: &Seat) {
    let mut news = seat.listen();
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

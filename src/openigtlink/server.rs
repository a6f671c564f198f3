//! The link's thread: takes clients, looks for the newest pose while one is there, sends each what it has not seen.

use std::net::{IpAddr, SocketAddr, TcpListener};
use std::sync::Arc;
use std::time::{Duration, Instant};

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::net::tcp::{OwnedReadHalf, OwnedWriteHalf};
use tokio::sync::watch;
use tokio::time::timeout;

use super::board::{Board, PLACES, Seat};
use super::error::LinkError;
use super::message::Instrument;
use crate::served::{Service, accept, bind};

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
    _service: Service,
}

impl Server {
    /// Serves `board` at an address and port (0: any that is free). `instrument` says where the instrument is, a hundred times a second while
    /// somebody is connected; `None` says that nothing is known.
    ///
    /// # Errors
    /// [`LinkError::Bind`] if the port is taken, [`LinkError::Thread`].
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

    /// Where it is.
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
    // As many as there are seats; the connection of one more is closed.
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
    // Only a matter of latency.
    let _ = stream.set_nodelay(true);
    let (reading, writing) = stream.into_split();
    tokio::select! {
        () = drain(reading) => {}
        () = show(writing, &seat) => {}
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

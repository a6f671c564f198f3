//! A server thread that ends when it is dropped.

use std::future::Future;
use std::io;
use std::net::{IpAddr, SocketAddr, TcpListener};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use named_threads::{join_before, lower_priority, spawn};
use tokio::net::TcpStream;
use tokio::sync::watch;
use tokio::time::sleep;

/// A listener at an address and port (0: any that is free), and its actual address.
///
/// # Errors
/// The requested address, and the error of the system.
pub fn bind((address, port): (IpAddr, u16)) -> Result<(TcpListener, SocketAddr), (SocketAddr, io::Error)> {
    let wanted = SocketAddr::new(address, port);
    let listen = || {
        let listener = TcpListener::bind(wanted)?;
        listener.set_nonblocking(true)?;
        let served = listener.local_addr()?;
        Ok((listener, served))
    };
    listen().map_err(|source| (wanted, source))
}

/// See the module.
#[derive(Debug)]
pub struct Service {
    stop: watch::Sender<bool>,
    thread: Option<JoinHandle<()>>,
    /// Time that its thread gets to end.
    farewell: Duration,
}

impl Service {
    /// Runs the future from `serve` in a named thread with lower priority. `serve` gets a receiver for the request to
    /// end; the thread then has the time `farewell` to finish.
    ///
    /// # Errors
    /// Why no thread could be started, or no runtime in it.
    pub fn start<F: Future<Output = ()>>(
        name: &str,
        farewell: Duration,
        serve: impl FnOnce(watch::Receiver<bool>) -> F + Send + 'static,
    ) -> Result<Self, String> {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_io().enable_time().build();
        let runtime = runtime.map_err(|e| e.to_string())?;
        let (stop, stopped) = watch::channel(false);
        let thread = spawn(name, move || {
            lower_priority();
            runtime.block_on(serve(stopped));
        });
        Ok(Self { stop, thread: Some(thread.map_err(|e| e.to_string())?), farewell })
    }
}

impl Drop for Service {
    fn drop(&mut self) {
        self.stop.send_replace(true);
        if let Some(thread) = self.thread.take() {
            let _ = join_before(thread, Instant::now() + self.farewell);
        }
    }
}

/// Passes on each connection; never returns.
pub async fn accept(listener: TcpListener, mut take: impl FnMut(TcpStream)) {
    let Ok(listener) = tokio::net::TcpListener::from_std(listener) else { return };
    loop {
        match listener.accept().await {
            Ok((stream, _)) => take(stream),
            // Out of file descriptors, or the peer has disconnected: an immediate retry would fail again.
            Err(_) => sleep(Duration::from_millis(50)).await,
        }
    }
}

//! Who is connected. There is room for some; one that has asked for nothing yet goes when another comes.

use std::collections::BTreeMap;
use std::net::{Shutdown, TcpStream};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Connections at one time, at most: eight pages, each with the one that tells it what is new and three by which it loads (browsers open up to six to a host).
pub(super) const CONNECTIONS: usize = 32;

/// All connections, by the order in which they came.
#[derive(Default)]
pub(super) struct Guests(Mutex<Book>);

#[derive(Default)]
struct Book {
    next: u64,
    /// The other end of those that have not asked yet; nothing of the others.
    guests: BTreeMap<u64, Option<TcpStream>>,
}

impl Guests {
    fn book(&self) -> MutexGuard<'_, Book> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes a connection in, and gives its number. Where there is no room, the oldest that has not asked is closed for it; where all have asked, there is none.
    pub(super) fn admit(&self, stream: &TcpStream) -> Option<u64> {
        let mut book = self.book();
        if book.guests.len() >= CONNECTIONS {
            let oldest = book.guests.iter().find(|(_, waits)| waits.is_some());
            let oldest = *oldest?.0;
            if let Some(Some(waits)) = book.guests.remove(&oldest) {
                // Its thread finds the connection at its end. One that is closed already is gone as well.
                let _ = waits.shutdown(Shutdown::Both);
            }
        }
        let guest = book.next;
        book.next += 1;
        book.guests.insert(guest, Some(stream.try_clone().ok()?));
        Some(guest)
    }

    /// A guest has asked: it stays until it is answered.
    pub(super) fn asked(&self, guest: u64) {
        if let Some(waits) = self.book().guests.get_mut(&guest) {
            *waits = None;
        }
    }

    /// A guest is gone.
    pub(super) fn leave(&self, guest: u64) {
        self.book().guests.remove(&guest);
    }

    #[cfg(test)]
    pub(super) fn count(&self) -> usize {
        self.book().guests.len()
    }
}

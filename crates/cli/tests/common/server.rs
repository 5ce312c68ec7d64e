//! A web server on loopback that says the same to every request.

use std::io::{BufRead, BufReader, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::{Arc, Mutex};

/// A server that ends with the test's process.
pub struct Server {
    /// Its address, e.g. `http://127.0.0.1:4711`.
    pub url: String,
    /// First lines and headers of the requests so far.
    pub requests: Arc<Mutex<Vec<String>>>,
}

/// Begins to serve. `answer` gets a request's head and writes the whole answer.
pub fn serve(
    answer: impl Fn(&str, &mut TcpStream) -> std::io::Result<()> + Send + 'static,
) -> Server {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let url = format!("http://{}", listener.local_addr().unwrap());
    let requests = Arc::new(Mutex::new(Vec::new()));
    let log = requests.clone();
    std::thread::spawn(move || {
        for mut stream in listener.incoming().flatten() {
            let mut head = String::new();
            let mut reader = BufReader::new(stream.try_clone().unwrap());
            while reader.read_line(&mut head).is_ok_and(|n| n > 2) {}
            log.lock().unwrap().push(head.clone());
            // A client that has left is no reason to stop.
            let _ = answer(&head, &mut stream);
        }
    });
    Server { url, requests }
}

/// Serves one file, from its beginning, whatever is asked for.
pub fn serve_file(bytes: Vec<u8>) -> Server {
    serve(move |_, stream| {
        write_head(stream, "200 OK", bytes.len())?;
        stream.write_all(&bytes)
    })
}

/// Writes the head of an answer of so many bytes.
pub fn write_head(stream: &mut TcpStream, status: &str, length: usize) -> std::io::Result<()> {
    write!(
        stream,
        "HTTP/1.1 {status}\r\nContent-Length: {length}\r\nConnection: close\r\n\r\n"
    )
}

//! `palpate serve --foxglove`: a client of Foxglove's WebSocket protocol (RFC 6455, `foxglove.sdk.v1`) that is written out here.

use std::collections::BTreeMap;
use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::TcpStream;
use std::time::Instant;

use palpate_tests::rig::PATIENCE;
use serde_json::{Value, json};

use crate::recording::calibrated;
use crate::serve::{Finger, Serving};

/// A connection after its handshake.
struct Client(BufReader<TcpStream>);

/// A message from the server.
enum Told {
    Text(Value),
    Binary(Vec<u8>),
}

impl Client {
    fn connect(address: &str) -> Self {
        let mut stream = TcpStream::connect(address).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        // The key of the example in RFC 6455, and what it says the answer to it is.
        let request = format!(
            "GET / HTTP/1.1\r\nHost: {address}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n\
             Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Protocol: foxglove.sdk.v1\r\n\r\n"
        );
        stream.write_all(request.as_bytes()).unwrap();
        let mut stream = BufReader::new(stream);
        let head: Vec<String> =
            stream.by_ref().lines().map(Result::unwrap).take_while(|line| !line.is_empty()).collect();
        let head = head.join("\n").to_lowercase();
        assert!(head.starts_with("http/1.1 101") && head.contains("s3pplmbitxaq9kygzzhzrbk+xoo="), "{head}");
        assert!(head.contains("sec-websocket-protocol: foxglove.sdk.v1"), "{head}");
        Self(stream)
    }

    /// Sends a text, masked as clients do.
    fn send(&mut self, text: &str) {
        let mask = [0x12, 0x34, 0x56, 0x78];
        let mut frame = vec![0x81];
        match u8::try_from(text.len()) {
            Ok(length @ 0..=125) => frame.push(0x80 | length),
            _ => {
                frame.push(0x80 | 126);
                frame.extend(u16::try_from(text.len()).unwrap().to_be_bytes());
            }
        }
        frame.extend(mask);
        frame.extend(text.bytes().zip(mask.iter().cycle()).map(|(byte, mask)| byte ^ mask));
        self.0.get_mut().write_all(&frame).unwrap();
    }

    fn bytes<const N: usize>(&mut self) -> [u8; N] {
        let mut bytes = [0; N];
        self.0.read_exact(&mut bytes).unwrap();
        bytes
    }

    fn next(&mut self) -> Told {
        loop {
            let [kind, length] = self.bytes();
            assert!(kind & 0x80 != 0 && length & 0x80 == 0, "a piece of a message, or a masked one");
            let length = match length {
                126 => usize::from(u16::from_be_bytes(self.bytes())),
                127 => usize::try_from(u64::from_be_bytes(self.bytes())).unwrap(),
                length => usize::from(length),
            };
            let mut data = vec![0; length];
            self.0.read_exact(&mut data).unwrap();
            match kind & 0x0f {
                1 => return Told::Text(serde_json::from_slice(&data).unwrap()),
                2 => return Told::Binary(data),
                // A ping.
                9 => {}
                other => panic!("a frame of kind {other}"),
            }
        }
    }
}

/// Force along x of a `WrenchStamped` in little-endian CDR: behind the encapsulation, the stamp and the frame's name.
fn force_x(cdr: &[u8]) -> f64 {
    let body = &cdr[4..];
    let length = u32::from_le_bytes(body[8..12].try_into().unwrap()) as usize;
    let at = (12 + length).next_multiple_of(8);
    f64::from_le_bytes(body[at..at + 8].try_into().unwrap())
}

#[test]
fn a_client_of_foxgloves_protocol_gets_the_force_that_presses() {
    let folder = tempfile::tempdir().unwrap();
    let calibration = calibrated(folder.path());
    let mut finger = Finger::start(&[]);
    let words = ["-d", &finger.path, "-c", &calibration, "--tare", "0.5", "--foxglove", "0"];
    let serving = Serving::start(folder.path(), &words);
    let address = serving.more.strip_prefix("ws://").unwrap_or_else(|| panic!("{}", serving.more));
    let mut client = Client::connect(address);
    let Told::Text(info) = client.next() else { panic!("no text first") };
    assert_eq!(info["op"], "serverInfo", "{info}");
    let deadline = Instant::now() + PATIENCE;
    let mut topics = BTreeMap::new();
    while !topics.contains_key("/finger/wrench") {
        assert!(Instant::now() < deadline, "{topics:?}");
        if let Told::Text(told) = client.next() {
            for channel in told["channels"].as_array().into_iter().flatten() {
                topics.insert(channel["topic"].as_str().unwrap().to_owned(), channel.clone());
            }
        }
    }
    let wrench = &topics["/finger/wrench"];
    assert_eq!((&wrench["encoding"], &wrench["schemaEncoding"]), (&json!("cdr"), &json!("ros2msg")), "{wrench}");
    assert_eq!(wrench["schemaName"], "geometry_msgs/msg/WrenchStamped");
    assert!(topics.contains_key("/finger/wrench_raw") && !topics.contains_key("/link/received"), "{topics:?}");
    client.send(&json!({ "op": "subscribe", "subscriptions": [{ "id": 7, "channelId": wrench["id"] }] }).to_string());
    finger.order("press 0 2");
    // At 0 degrees the finger is pushed back along x.
    let (mut times, mut last) = (Vec::new(), 0.0);
    while (last + 2.0_f64).abs() > 0.05 || times.len() < 500 {
        assert!(Instant::now() < deadline, "{last} N after {} messages", times.len());
        if let Told::Binary(data) = client.next() {
            assert_eq!((data[0], u32::from_le_bytes(data[1..5].try_into().unwrap())), (1, 7));
            times.push(u64::from_le_bytes(data[5..13].try_into().unwrap()));
            last = force_x(&data[13..]);
        }
    }
    // Block after block, 2 ms each.
    let steps: Vec<u64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let mean_ms = steps.iter().sum::<u64>() as f64 / steps.len() as f64 / 1e6;
    assert!((mean_ms - 2.0).abs() < 0.1, "{mean_ms} ms");
}

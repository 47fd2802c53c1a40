//! The port on a bus in memory, with a host that enumerates it by the USB standard's own numbers.

use std::boxed::Box;
use std::collections::{HashMap, VecDeque};
use std::string::{String, ToString};
use std::sync::{Arc, Mutex};
use std::vec::Vec;
use std::{format, vec};

use usb_device::bus::{PollResult, UsbBus, UsbBusAllocator};
use usb_device::endpoint::{EndpointAddress, EndpointType};
use usb_device::{Result, UsbDirection, UsbError};

use super::{MEMORY_WORDS, Maker, PACKET, Port, SENT};

/// Turns of the device within which it must have answered a request of the host.
const TURNS: usize = 64;

/// What is on the wire: at most one packet each way for each pipe.
#[derive(Default)]
struct Wire {
    to_device: HashMap<usize, VecDeque<(bool, Vec<u8>)>>,
    to_host: HashMap<usize, Vec<u8>>,
    fetched: u16,
    stalled: bool,
    address: u8,
    was_reset: bool,
    memory_bytes: usize,
}

/// The bus, which the host in the test shares.
#[derive(Clone, Default)]
struct Bus {
    wire: Arc<Mutex<Wire>>,
    used: [usize; 2],
}

impl UsbBus for Bus {
    fn alloc_ep(
        &mut self,
        direction: UsbDirection,
        address: Option<EndpointAddress>,
        _: EndpointType,
        max_packet_size: u16,
        _: u8,
    ) -> Result<EndpointAddress> {
        let used = &mut self.used[usize::from(direction == UsbDirection::In)];
        let index = address.map_or(*used + 1, |address| address.index());
        *used = index.max(*used);
        if direction == UsbDirection::Out {
            self.wire.lock().unwrap().memory_bytes += usize::from(max_packet_size);
        }
        Ok(EndpointAddress::from_parts(index, direction))
    }

    fn enable(&mut self) {
        self.wire.lock().unwrap().was_reset = true;
    }

    fn reset(&self) {}

    fn set_device_address(&self, address: u8) {
        self.wire.lock().unwrap().address = address;
    }

    fn write(&self, endpoint: EndpointAddress, bytes: &[u8]) -> Result<usize> {
        let mut wire = self.wire.lock().unwrap();
        if wire.to_host.contains_key(&endpoint.index()) {
            return Err(UsbError::WouldBlock);
        }
        wire.to_host.insert(endpoint.index(), bytes.to_vec());
        Ok(bytes.len())
    }

    fn read(&self, endpoint: EndpointAddress, bytes: &mut [u8]) -> Result<usize> {
        let mut wire = self.wire.lock().unwrap();
        let (_, packet) =
            wire.to_device.get_mut(&endpoint.index()).and_then(VecDeque::pop_front).ok_or(UsbError::WouldBlock)?;
        let place = bytes.get_mut(..packet.len()).ok_or(UsbError::BufferOverflow)?;
        place.copy_from_slice(&packet);
        Ok(packet.len())
    }

    fn set_stalled(&self, _: EndpointAddress, stalled: bool) {
        self.wire.lock().unwrap().stalled |= stalled;
    }

    fn is_stalled(&self, _: EndpointAddress) -> bool {
        false
    }

    fn suspend(&self) {}

    fn resume(&self) {}

    fn poll(&self) -> PollResult {
        let mut wire = self.wire.lock().unwrap();
        if std::mem::take(&mut wire.was_reset) {
            return PollResult::Reset;
        }
        let (mut ep_out, mut ep_setup) = (0, 0);
        for (endpoint, packets) in &wire.to_device {
            match packets.front() {
                Some((true, _)) => ep_setup |= 1 << endpoint,
                Some((false, _)) => ep_out |= 1 << endpoint,
                None => {}
            }
        }
        let ep_in_complete = std::mem::take(&mut wire.fetched);
        PollResult::Data { ep_out, ep_in_complete, ep_setup }
    }
}

/// The host, and the port at its other end.
struct Bench<'a> {
    wire: Arc<Mutex<Wire>>,
    port: Port<'a, Bus>,
}

impl<'a> Bench<'a> {
    /// A host that has found the port and taken it into use.
    fn new(bus: &'a UsbBusAllocator<Bus>, wire: Arc<Mutex<Wire>>, (maker, number): (Maker, &'a str)) -> Self {
        let port = Port::new(bus, maker, number).expect("the bus carries anything");
        let mut bench = Self { wire, port };
        bench.port.poll();
        bench
    }

    /// USB 2.0, table 9-4: SET_ADDRESS and SET_CONFIGURATION.
    fn configure(&mut self) {
        self.order([0x00, 5, 17, 0, 0, 0, 0, 0]);
        assert_eq!(self.wire.lock().unwrap().address, 17);
        self.order([0x00, 9, 1, 0, 0, 0, 0, 0]);
    }

    fn put(&mut self, endpoint: usize, is_setup: bool, bytes: &[u8]) {
        let mut wire = self.wire.lock().unwrap();
        wire.to_device.entry(endpoint).or_default().push_back((is_setup, bytes.to_vec()));
    }

    /// What the host fetches from a pipe, if something is there.
    fn fetch(&mut self, endpoint: usize) -> Option<Vec<u8>> {
        let mut wire = self.wire.lock().unwrap();
        let packet = wire.to_host.remove(&endpoint)?;
        wire.fetched |= 1 << endpoint;
        Some(packet)
    }

    /// A request without data: the device answers by an empty packet.
    fn order(&mut self, setup: [u8; 8]) {
        self.put(0, true, &setup);
        let answer = (0..TURNS).find_map(|_| {
            self.port.poll();
            self.fetch(0)
        });
        assert_eq!(answer, Some(vec![]), "{setup:?}");
        self.port.poll();
        assert!(!self.wire.lock().unwrap().stalled, "{setup:?}");
    }

    /// A request for data: packets until a short one, then the host's empty one.
    fn ask(&mut self, setup: [u8; 8]) -> Vec<u8> {
        self.put(0, true, &setup);
        let (mut answer, wanted) = (vec![], usize::from(u16::from_le_bytes([setup[6], setup[7]])));
        for _ in 0..TURNS {
            self.port.poll();
            let Some(packet) = self.fetch(0) else { continue };
            answer.extend(&packet);
            if packet.len() < usize::from(PACKET) || answer.len() == wanted {
                break;
            }
        }
        self.port.poll();
        self.put(0, false, &[]);
        self.port.poll();
        answer
    }

    /// USB 2.0, section 9.6.7: UTF-16 behind two bytes.
    fn string(&mut self, index: u8) -> String {
        let answer = self.ask([0x80, 6, index, 3, 9, 4, 255, 0]);
        assert_eq!((usize::from(answer[0]), answer[1]), (answer.len(), 3));
        let units: Vec<u16> = answer[2..].chunks(2).map(|pair| u16::from_le_bytes([pair[0], pair[1]])).collect();
        String::from_utf16(&units).unwrap()
    }
}

/// The number of the device of these tests.
const NUMBER_OF_DEVICE: [u8; 12] = [0x01, 0x23, 0x45, 0x67, 0x89, 0xAB, 0xCD, 0xEF, 0x01, 0x23, 0x45, 0x67];

/// Runs a test on a port that a host has just found, of a board that somebody built for themselves.
fn on_a_port(test: impl FnOnce(&mut Bench<'_>)) {
    on_a_port_of(Maker::of(None), test);
}

/// The same of a board of this maker's.
fn on_a_port_of(maker: Maker, test: impl FnOnce(&mut Bench<'_>)) {
    let serial_number = maker.serial_number(&NUMBER_OF_DEVICE);
    let bus = Bus::default();
    let wire = bus.wire.clone();
    let allocator = UsbBusAllocator::new(bus);
    test(&mut Bench::new(&allocator, wire, (maker, &serial_number)));
}

#[test]
fn a_host_finds_a_serial_port_with_the_devices_number() {
    on_a_port(|bench| {
        // GET_DESCRIPTOR of the device: 18 bytes.
        let device = bench.ask([0x80, 6, 0, 1, 0, 0, 18, 0]);
        assert_eq!((device.len(), device[0], device[1]), (18, 18, 1));
        // Class "communications", packets of 64 bytes, vendor and product.
        assert_eq!((device[4], device[7], &device[8..12]), (2, 64, &[0x09, 0x12, 0x01, 0x00][..]));
        let strings = [14, 15, 16].map(|at| bench.string(device[at]));
        assert_eq!(strings, ["palpate", "palpate finger", "0123456789abcdef01234567"].map(|text| text.to_string()));
        // GET_DESCRIPTOR of the configuration: its length says how long it is.
        let configuration = bench.ask([0x80, 6, 0, 2, 0, 0, 255, 0]);
        assert_eq!(usize::from(u16::from_le_bytes([configuration[2], configuration[3]])), configuration.len());
        let (mut at, mut pipes) = (0, vec![]);
        while at < configuration.len() {
            let descriptor = &configuration[at..at + usize::from(configuration[at])];
            if descriptor[1] == 5 {
                pipes.push((descriptor[2] & 0x80 != 0, descriptor[3] & 3, descriptor[4]));
            }
            at += descriptor.len();
        }
        // Events by interrupt, data by bulk both ways.
        assert_eq!(pipes, [(true, 3, 8), (true, 2, 64), (false, 2, 64)]);
    });
}

#[test]
fn a_maker_with_a_domain_has_the_shared_pair_and_the_domain_before_the_number() {
    // The longest that there is room for, too.
    for domain in ["fingers.example.org", "a-domain-of-thirty-eight.example.co.uk"] {
        on_a_port_of(Maker::of(Some(domain)), |bench| {
            let device = bench.ask([0x80, 6, 0, 1, 0, 0, 18, 0]);
            assert_eq!(device[8..12], [0xC0, 0x16, 0xDD, 0x27]);
            let strings = [14, 15, 16].map(|at| bench.string(device[at]));
            let number = format!("{domain}:0123456789abcdef01234567");
            assert_eq!(strings, [domain, "palpate finger", number.as_str()].map(ToString::to_string));
        });
    }
}

#[test]
fn what_is_no_domain_builds_no_image() {
    for domain in
        ["", "example", ".org", "example.", "a..b", "Example.org", "example.org/x", "mail@example.org", "a b.c"]
    {
        assert!(std::panic::catch_unwind(|| Maker::of(Some(domain))).is_err(), "{domain:?}");
    }
    let long: &'static str = Box::leak(format!("{}.org", "a".repeat(35)).into_boxed_str());
    assert!(std::panic::catch_unwind(|| Maker::of(Some(long))).is_err(), "{long}");
}

#[test]
fn what_comes_in_needs_no_more_memory_than_the_bus_is_given() {
    on_a_port(|bench| assert_eq!(bench.wire.lock().unwrap().memory_bytes, 4 * MEMORY_WORDS));
}

#[test]
fn bytes_come_through_in_order_both_ways() {
    on_a_port(|bench| {
        bench.configure();
        let given: Vec<u8> = (0..=255).cycle().take(1000).collect();
        let mut received = vec![];
        for packet in given.chunks(usize::from(PACKET)) {
            bench.put(1, false, packet);
            bench.port.poll();
            let mut buffer = [0; 128];
            received.extend_from_slice(bench.port.receive(&mut buffer));
            assert!(bench.port.receive(&mut buffer).is_empty(), "a packet comes once");
        }
        assert_eq!(received, given);

        let (mut rest, mut fetched) = (&given[..], vec![]);
        while !rest.is_empty() {
            let taken = bench.port.send(rest);
            rest = &rest[taken..];
            assert_eq!(bench.port.send(rest), 0, "while the last packet waits");
            let packet = bench.fetch(2).expect("a packet");
            // A full one would not end a transfer: the host would hold it back.
            assert!((1..=SENT).contains(&packet.len()) && packet.len() == taken, "{}", packet.len());
            fetched.extend(packet);
            bench.port.poll();
        }
        assert_eq!(fetched, given);
        assert_eq!(bench.port.send(&[]), 0);
    });
}

#[test]
fn a_serial_ports_settings_are_taken_and_change_nothing() {
    on_a_port(|bench| {
        bench.configure();
        // SET_CONTROL_LINE_STATE: a program opens and closes the port (PSTN 1.2, section 6.3.12).
        for state in [3, 0] {
            bench.order([0x21, 0x22, state, 0, 0, 0, 0, 0]);
            let text = format!("{state}");
            assert_eq!(bench.port.send(text.as_bytes()), 1);
            assert_eq!(bench.fetch(2), Some(text.into_bytes()));
        }
    });
}

//! A serial port over USB (CDC-ACM): the board's second link, on whatever USB bus there is.
//!
//! Bytes go out in packets that are never full, so each ends a transfer and the host hands it on at once; no empty
//! packets have to be sent. The port holds no bytes itself but those of one packet, in the bus's own memory.
//! Polled: [`Port::poll`] wants to be called whenever the bus has something to say.
//! Errors: none; a bus that cannot carry it gives no port.
//! Source: USB 2.0, chapter 9; CDC 1.2 and PSTN 1.2.

use heapless::String;
use usb_device::bus::{UsbBus, UsbBusAllocator};
use usb_device::device::{StringDescriptors, UsbDevice, UsbDeviceBuilder, UsbVidPid};
use usbd_serial::{CdcAcmClass, USB_CLASS_CDC};

/// Vendor and product that Objective Development shares out for CDC-ACM devices. Its rules ("USB-IDs-for-free"): the
/// manufacturer's name holds a domain of the maker's, and the serial number begins with it, by which such devices are told apart.
const SHARED: UsbVidPid = UsbVidPid(0x16C0, 0x27DD);

/// Vendor and product that pid.codes keeps for tests: for who builds a board for themselves, and not for one that is handed on.
const TEST: UsbVidPid = UsbVidPid(0x1209, 0x0001);

/// Characters of a device's number in hexadecimal.
pub const NUMBER: usize = 24;

/// Characters of a domain at most: with a colon and the number behind it, what the control pipe's buffer has room for.
const DOMAIN_MAX: usize = 63 - 1 - NUMBER;

/// Who made a board, as USB wants it.
///
/// ```
/// use palpate_firmware_usb::port::Maker;
/// let maker = Maker::of(Some("fingers.example.org"));
/// assert_eq!(maker.serial_number(b"0123456789ab").as_str(), "fingers.example.org:303132333435363738396162");
/// assert_eq!(Maker::of(None).serial_number(b"0123456789ab").as_str(), "303132333435363738396162");
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Maker {
    domain: Option<&'static str>,
}

impl Maker {
    /// Who has this Internet domain, or somebody who builds a board for themselves.
    ///
    /// # Panics
    /// If it is no domain, or longer than 38 characters: when the image is built, since this is for a constant.
    #[must_use]
    pub const fn of(domain: Option<&'static str>) -> Self {
        if let Some(domain) = domain {
            let (bytes, mut at, mut has_dot) = (domain.as_bytes(), 0, false);
            while at < bytes.len() {
                let is_dot = bytes[at] == b'.';
                assert!(
                    is_dot || bytes[at] == b'-' || bytes[at].is_ascii_lowercase() || bytes[at].is_ascii_digit(),
                    "a domain has lower-case letters, digits, hyphens and dots"
                );
                let is_inside = at > 0 && at + 1 < bytes.len() && bytes[at - 1] != b'.';
                assert!(!is_dot || is_inside, "a domain's dots are between its names");
                has_dot = has_dot || is_dot;
                at += 1;
            }
            assert!(has_dot, "a domain has a dot, as example.org has");
            assert!(bytes.len() <= DOMAIN_MAX, "a domain of more than 38 characters has no room");
        }
        Self { domain }
    }

    /// The serial number of the device with this number.
    #[must_use]
    pub fn serial_number(&self, number: &[u8; NUMBER / 2]) -> String<63> {
        let mut text = String::new();
        // All of it fits: `of` has seen to that.
        if let Some(domain) = self.domain {
            let _ = text.push_str(domain).and_then(|()| text.push(':'));
        }
        for byte in number {
            let digits = [byte >> 4, byte & 0xF].map(|digit| char::from_digit(digit.into(), 16).unwrap_or('?'));
            let _ = digits.into_iter().try_for_each(|digit| text.push(digit));
        }
        text
    }

    const fn vendor_product(self) -> UsbVidPid {
        if self.domain.is_some() { SHARED } else { TEST }
    }
}

/// Bytes in a packet at most, of the control pipe and of the data pipes: the most at full speed.
const PACKET: u16 = 64;

/// Bytes sent in a packet at most: one less than it holds.
const SENT: usize = PACKET as usize - 1;

/// Words of memory that the bus needs for what comes in: a packet of the control pipe and one of data.
pub const MEMORY_WORDS: usize = 2 * PACKET as usize / 4;

/// A serial port over USB: one stream of bytes each way.
pub struct Port<'a, B: UsbBus> {
    device: UsbDevice<'a, B>,
    class: CdcAcmClass<'a, B>,
}

impl<'a, B: UsbBus> Port<'a, B> {
    /// A port that shows up at the host as of this maker and with this serial number; `None` if the bus cannot carry it.
    pub fn new(bus: &'a UsbBusAllocator<B>, maker: Maker, serial_number: &'a str) -> Option<Self> {
        let class = CdcAcmClass::new(bus, PACKET);
        let strings =
            StringDescriptors::default().manufacturer(maker.domain.unwrap_or("palpate")).product("palpate finger");
        let builder = UsbDeviceBuilder::new(bus, maker.vendor_product()).device_class(USB_CLASS_CDC);
        let builder = builder.strings(&[strings.serial_number(serial_number)]).ok()?;
        Some(Self { device: builder.max_packet_size_0(PACKET.to_le_bytes()[0]).ok()?.build(), class })
    }

    /// Answers what the host wants of any USB device.
    pub fn poll(&mut self) {
        self.device.poll(&mut [&mut self.class]);
    }

    /// What has come, one packet of it; the buffer has room for any.
    pub fn receive<'b>(&mut self, buffer: &'b mut [u8]) -> &'b [u8] {
        let length = self.class.read_packet(buffer).unwrap_or(0);
        buffer.get(..length).unwrap_or_default()
    }

    /// Takes as many of these bytes as a packet holds, if the host has fetched the last one; tells how many.
    pub fn send(&mut self, bytes: &[u8]) -> usize {
        let packet = bytes.get(..SENT).unwrap_or(bytes);
        if packet.is_empty() { 0 } else { self.class.write_packet(packet).unwrap_or(0) }
    }
}

#[cfg(test)]
mod tests;

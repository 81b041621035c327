// uvc_camera FPS LOG JPEG... : a USB camera in user space, plugged into vhci_hcd; the real uvcvideo binds to it.
//
// Speaks USB/IP (Documentation/usb/usbip_protocol.rst) on one end of a socket pair whose other end is handed to
// vhci_hcd, and is a UVC 1.0 device (USB Device Class Definition for Video Devices 1.0) with ONE BULK endpoint:
// isochronous transfers would need a host controller that paces them. Formats: 1 = MJPG, 2 = YUYV, 3 = GREY, 640x480.
//
// Every frame carries its number: a JPEG as a COM segment "HIL%08u" after SOI, YUYV/GREY as its fill byte. The number
// counts frame PERIODS spent streaming (from 100000 on after the first replug, and so on), so a reader of the log sees exactly which ones never arrived.
//
// Faults, one character each on the FIFO /tmp/uvc:
//   e  ERR bit in the next frame          t  next frame cut to half (MJPG: no EOI, and no flag)
//   d  5 frames dropped inside the device s  silent for 2 s             h  bulk endpoint halts (EPIPE)
//   u  unplug and exit
// LOG gets one line per happening: CLOCK_MONOTONIC [s], word, number; it is the truth the checks compare with.
#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

enum { WIDTH = 640, HEIGHT = 480, MAX_PAYLOAD = 16384, HEADER = 12, MAX_PENDING = 256, MAX_JPEGS = 16, COM_BYTES = 15, REPLUG_STEP = 100000 };
enum { MJPG = 1, YUYV = 2, GREY = 3 };
enum { USBIP_CMD_SUBMIT = 1, USBIP_CMD_UNLINK = 2, USBIP_RET_SUBMIT = 3, USBIP_RET_UNLINK = 4 };

#define LE16(x) (x) & 255, ((x) >> 8) & 255
#define LE32(x) (x) & 255, ((x) >> 8) & 255, ((x) >> 16) & 255, ((x) >> 24) & 255
#define INTERVAL_100NS(fps) (10000000 / (fps))

static const uint8_t device_descriptor[] = {18, 1, LE16(0x0200), 0xEF, 2, 1, 64, LE16(0x1d6b), LE16(0x0102), LE16(0x100), 1, 2, 3, 1};

#define FRAME_DESC(subtype, bits_per_s, bytes)                                                                     \
  38, 0x24, subtype, 1, 0, LE16(WIDTH), LE16(HEIGHT), LE32(bits_per_s), LE32(bits_per_s), LE32(bytes),             \
      LE32(INTERVAL_100NS(30)), 3, LE32(INTERVAL_100NS(30)), LE32(INTERVAL_100NS(25)), LE32(INTERVAL_100NS(15))
// Uncompressed format: GUID = fourcc + the fixed tail of the Microsoft media types.
#define RAW_FORMAT(index, a, b, c, d, bits) \
  27, 0x24, 4, index, 1, a, b, c, d, 0, 0, 0x10, 0, 0x80, 0, 0, 0xaa, 0, 0x38, 0x9b, 0x71, bits, 1, 0, 0, 0, 0
#define STREAM_HEADER_TOTAL (16 + 11 + 38 + 27 + 38 + 27 + 38 + 6)
static const uint8_t config_tail[] = {
    8, 0x0b, 0, 2, 0x0e, 3, 0, 0,                                               // interface association: video
    9, 4, 0, 0, 0, 0x0e, 1, 0, 0,                                               // VideoControl interface
    13, 0x24, 1, LE16(0x100), LE16(40), LE32(48000000), 1, 1,                   // UVC 1.0, 48 MHz device clock
    18, 0x24, 2, 1, LE16(0x201), 0, 0, 0, 0, 0, 0, 0, 0, 3, 0, 0, 0,            // camera terminal 1
    9, 0x24, 3, 2, LE16(0x101), 0, 1, 0,                                        // output terminal 2 fed by 1
    9, 4, 1, 0, 1, 0x0e, 2, 0, 0,                                               // VideoStreaming interface
    16, 0x24, 1, 3, LE16(STREAM_HEADER_TOTAL), 0x81, 0, 2, 0, 0, 0, 1, 0, 0, 0, // 3 formats on endpoint 0x81
    11, 0x24, 6, 1, 1, 1, 1, 0, 0, 0, 0, FRAME_DESC(7, 49152000, WIDTH *HEIGHT * 2),
    RAW_FORMAT(2, 'Y', 'U', 'Y', '2', 16), FRAME_DESC(5, WIDTH *HEIGHT * 2 * 8 * 30, WIDTH *HEIGHT * 2),
    RAW_FORMAT(3, 'Y', '8', '0', '0', 8), FRAME_DESC(5, WIDTH *HEIGHT * 8 * 30, WIDTH *HEIGHT),
    6, 0x24, 0x0d, 1, 1, 4,                                                     // BT.709 colours
    7, 5, 0x81, 2, LE16(512), 0};                                               // bulk IN
static uint8_t config[9 + sizeof config_tail];

struct usbip_header { uint32_t command, seqnum, devid, direction, endpoint, arg[5]; uint8_t setup[8]; };
struct pending { uint32_t seqnum, length; };

static int usb = -1;                        // our end of the USB/IP socket
static FILE *truth;
static struct pending queue[MAX_PENDING];   // bulk IN requests the driver has out
static int queued;
static uint8_t probe[26], commit[26];
static int streaming, restarted, halted;
static struct { uint8_t *data; uint32_t length; } jpegs[MAX_JPEGS];
static int jpeg_count;
static uint8_t frame[WIDTH * HEIGHT * 2];

static double now_s(void) { struct timespec t; clock_gettime(CLOCK_MONOTONIC, &t); return t.tv_sec + t.tv_nsec * 1e-9; }
static void note(const char *format, ...) {
  va_list a; va_start(a, format);
  fprintf(truth, "%.6f ", now_s()); vfprintf(truth, format, a); fputc('\n', truth); fflush(truth);
  va_end(a);
}
static int read_all(void *p, size_t n) {
  for (size_t k = 0; k < n;) { ssize_t r = read(usb, (char *)p + k, n - k); if (r <= 0) return -1; k += r; }
  return 0;
}
static void write_all(const void *p, size_t n) {
  for (size_t k = 0; k < n;) { ssize_t r = write(usb, (const char *)p + k, n - k); if (r <= 0) { note("gone %d", errno); exit(3); } k += r; }
}
static void reply(uint32_t command, uint32_t seqnum, int status, const void *data, uint32_t length, uint32_t actual) {
  static uint8_t b[48 + 65536];
  uint32_t words[12] = {htonl(command), htonl(seqnum), 0, 0, 0, htonl(status), htonl(actual)};
  memcpy(b, words, 48);
  if (length) memcpy(b + 48, data, length);
  write_all(b, 48 + length);
}
static struct pending take(void) { struct pending p = queue[0]; memmove(queue, queue + 1, --queued * sizeof *queue); return p; }

// Video probe/commit control, 26 bytes (UVC 1.0 table 4-47): keep what the host chose, fill in what the device decides.
static void complete_probe(uint8_t *p) {
  if (p[2] < MJPG || p[2] > GREY) p[2] = MJPG;
  p[3] = 1;
  uint32_t interval; memcpy(&interval, p + 4, 4);
  if (!interval) { interval = INTERVAL_100NS(30); memcpy(p + 4, &interval, 4); }
  uint32_t size = p[2] == GREY ? WIDTH * HEIGHT : WIDTH * HEIGHT * 2, payload = MAX_PAYLOAD;
  memcpy(p + 18, &size, 4); memcpy(p + 22, &payload, 4);
}
static int string_descriptor(int i, uint8_t *o) {
  static const char *text[] = {"", "Hydroline", "HIL camera", "HIL0001"};
  if (i == 0) { memcpy(o, (uint8_t[]){4, 3, 9, 4}, 4); return 4; }
  if (i > 3) return -1;
  int n = strlen(text[i]);
  o[0] = 2 + 2 * n; o[1] = 3;
  for (int k = 0; k < n; k++) { o[2 + 2 * k] = text[i][k]; o[3 + 2 * k] = 0; }
  return o[0];
}
static void control_transfer(const struct usbip_header *h, const uint8_t *out, uint32_t out_length) {
  const uint8_t *s = h->setup;
  uint8_t type = s[0], request = s[1];
  uint16_t value = s[2] | s[3] << 8, length = s[6] | s[7] << 8;
  uint8_t b[512]; int n = -1;
  if (type == 0x80 && request == 6) {                                                   // GET_DESCRIPTOR
    if (value >> 8 == 1) memcpy(b, device_descriptor, n = sizeof device_descriptor);
    else if (value >> 8 == 2) memcpy(b, config, n = sizeof config);
    else if (value >> 8 == 3) n = string_descriptor(value & 255, b);
  } else if ((type & 0xe0) == 0x80 && request == 0) { b[0] = b[1] = 0; n = 2; }         // GET_STATUS
  else if (type == 0x81 && request == 10) { b[0] = 0; n = 1; }                          // GET_INTERFACE
  else if (type == 0 && (request == 9 || request == 5)) n = 0;                          // SET_CONFIGURATION, SET_ADDRESS
  else if (type == 1 && request == 11) n = 0;                                           // SET_INTERFACE
  else if (type == 2 && request == 1) {                                                 // CLEAR_FEATURE(ENDPOINT_HALT)
    n = 0; halted = 0;                                                                  // = stream off for bulk cameras
    if (streaming) note("stream_off 0");
    streaming = 0;
  } else if (type == 0x21 && request == 1 && s[4] == 1) {                               // SET_CUR probe / commit
    uint8_t *p = value >> 8 == 2 ? commit : probe;
    n = 0; memcpy(p, out, out_length > 26 ? 26 : out_length); complete_probe(p);
    if (p == commit) { streaming = 1; restarted = 1; note("stream_on %d", p[2]); }
  } else if (type == 0xa1 && s[4] == 1) {                                               // GET_INFO/LEN/CUR/MIN/MAX/DEF
    if (request == 0x86) { b[0] = 3; n = 1; }
    else if (request == 0x85) { b[0] = 26; b[1] = 0; n = 2; }
    else { memcpy(b, value >> 8 == 2 ? commit : probe, 26); complete_probe(b); n = 26; }
  }
  if (n < 0) { reply(USBIP_RET_SUBMIT, h->seqnum, -EPIPE, 0, 0, 0); return; }
  if (n > length) n = length;
  if (type & 0x80) reply(USBIP_RET_SUBMIT, h->seqnum, 0, b, n, n);
  else reply(USBIP_RET_SUBMIT, h->seqnum, 0, 0, 0, out_length);
}
static int serve_usb(void) {
  struct usbip_header h;
  if (read_all(&h, 48)) return -1;
  uint32_t *w = (uint32_t *)&h;
  for (int i = 0; i < 10; i++) w[i] = ntohl(w[i]);
  if (h.command == USBIP_CMD_SUBMIT) {
    static uint8_t out[65536];
    uint32_t length = h.arg[1];
    if (h.direction == 0 && length && (length > sizeof out || read_all(out, length))) return -1;
    if (h.endpoint == 0) control_transfer(&h, out, h.direction == 0 ? length : 0);
    else if (queued < MAX_PENDING) queue[queued++] = (struct pending){h.seqnum, length};
  } else if (h.command == USBIP_CMD_UNLINK) {
    int status = 0;
    for (int i = 0; i < queued; i++)
      if (queue[i].seqnum == h.arg[0]) {
        memmove(queue + i, queue + i + 1, (queued - i - 1) * sizeof *queue);
        queued--; status = -ECONNRESET; break;
      }
    reply(USBIP_RET_UNLINK, h.seqnum, status, 0, 0, 0);
  }
  return 0;
}
static uint32_t compose(uint32_t number) {
  if (commit[2] != MJPG) { uint32_t n = commit[2] == GREY ? WIDTH * HEIGHT : WIDTH * HEIGHT * 2; memset(frame, number & 255, n); return n; }
  const uint8_t *j = jpegs[number % jpeg_count].data;
  uint32_t n = jpegs[number % jpeg_count].length;
  char com[COM_BYTES + 1];
  memcpy(com, "\xff\xfe\x00\x0d", 4);                       // COM, length 13 = itself (2) + text (11)
  snprintf(com + 4, sizeof com - 4, "HIL%08u", number % 100000000u);
  memcpy(frame, j, 2);                                      // SOI
  memcpy(frame + 2, com, COM_BYTES);
  memcpy(frame + 2 + COM_BYTES, j + 2, n - 2);
  return n + COM_BYTES;
}
static int load_jpeg(const char *path) {
  FILE *f = fopen(path, "rb");
  if (!f) { perror(path); return -1; }
  uint8_t *d = malloc(sizeof frame);
  size_t n = d ? fread(d, 1, sizeof frame - COM_BYTES, f) : 0;
  fclose(f);
  if (n < 4 || d[0] != 0xff || d[1] != 0xd8) { fprintf(stderr, "%s: not a JPEG that fits\n", path); return -1; }
  jpegs[jpeg_count].data = d; jpegs[jpeg_count++].length = n;
  return 0;
}
static int plug_in(void) {
  int pair[2];
  if (socketpair(AF_UNIX, SOCK_STREAM, 0, pair)) { perror("socketpair"); return -1; }
  usb = pair[0];
  int a = open("/sys/devices/platform/vhci_hcd.0/attach", O_WRONLY);
  if (a < 0) { perror("vhci_hcd attach"); return -1; }
  char m[64]; int n = snprintf(m, sizeof m, "0 %d 65538 3", pair[1]);       // port, fd, devid 1-2, high speed
  if (write(a, m, n) != n) { perror("attach"); return -1; }
  close(a); close(pair[1]);
  return 0;
}
int main(int argc, char **argv) {
  if (argc < 4 || argc > 3 + MAX_JPEGS) { fprintf(stderr, "uvc_camera FPS LOG JPEG...\n"); return 2; }
  double period_s = 1.0 / atof(argv[1]);
  if (!(truth = fopen(argv[2], "a+"))) { perror(argv[2]); return 2; }
  uint32_t number = 0, offset = 0, length = 0, late = 0;
  char line[80];
  while (fgets(line, sizeof line, truth)) if (strstr(line, "plugged")) number += REPLUG_STEP;   // no number twice in a log
  for (int i = 3; i < argc; i++) if (load_jpeg(argv[i])) return 2;
  memcpy(config, (uint8_t[]){9, 2, LE16(sizeof config), 2, 1, 0, 0x80, 50}, 9);
  memcpy(config + 9, config_tail, sizeof config_tail);
  complete_probe(probe); complete_probe(commit);
  mkfifo("/tmp/uvc", 0600);
  int faults = open("/tmp/uvc", O_RDWR | O_NONBLOCK);
  if (faults < 0 || plug_in()) return 1;
  note("plugged 0");

  int fid = 0, error_next = 0, error_bit = 0, cut = 0, drop = 0, sending = 0;
  double due = 0, silent_until = 0;
  for (;;) {
    int wait_ms = !streaming ? 1000 : sending && queued ? 0 : (int)((due - now_s()) * 1000) + 1;
    struct pollfd p[2] = {{usb, POLLIN, 0}, {faults, POLLIN, 0}};
    poll(p, 2, wait_ms < 0 ? 0 : wait_ms);
    if (p[1].revents & POLLIN) {
      char k[16]; int n = read(faults, k, sizeof k);
      for (int i = 0; i < n; i++) switch (k[i]) {
          case 'e': error_next = 1; break;
          case 't': cut = 1; break;
          case 'd': drop = 5; break;
          case 's': silent_until = now_s() + 2; note("silent %u", number); break;
          case 'h': halted = 1; note("halt %u", number); break;
          case 'u': note("unplug %u", number); return 0;
        }
    }
    if (p[0].revents) { if (serve_usb()) { note("host_gone %u", number); return 0; } continue; }
    double t = now_s();
    if (!streaming) { sending = 0; offset = 0; continue; }
    if (restarted) { restarted = 0; due = t + period_s; sending = 0; offset = 0; }   // numbers go on: none occurs twice
    if (halted) { while (queued) reply(USBIP_RET_SUBMIT, take().seqnum, -EPIPE, 0, 0, 0); due = t + 0.01; continue; }
    if (!sending && t >= due) {
      // The sensor does not wait for the bus: a period that could not start in time is a frame that never was.
      while (t - due > period_s) { due += period_s; number++; if (t >= silent_until) note("late %u", ++late); else note("withheld %u", number); }
      due += period_s; number++;
      if (t < silent_until) { note("withheld %u", number); continue; }
      if (drop) { drop--; note("dropped %u", number); continue; }
      length = compose(number);
      if (cut) { cut = 0; length /= 2; note("truncated %u", number); }
      error_bit = error_next; error_next = 0;                // a whole frame or none
      if (error_bit) note("error_bit %u", number);
      offset = 0; sending = 1;
    }
    if (sending && queued) {
      struct pending r = take();
      uint8_t b[MAX_PAYLOAD];
      uint32_t room = r.length < MAX_PAYLOAD ? r.length : MAX_PAYLOAD, n = room - HEADER;
      if (n > length - offset) n = length - offset;
      uint32_t clock = (uint32_t)(t * 48e6), sof = (uint32_t)(t * 1000) & 0x7ff;
      b[0] = HEADER; b[1] = 0x8c | fid | (offset + n == length ? 2 : 0) | (error_bit ? 0x40 : 0);   // EOH|SCR|PTS, EOF, ERR
      memcpy(b + 2, &clock, 4); memcpy(b + 6, &clock, 4); b[10] = sof; b[11] = sof >> 8;
      memcpy(b + HEADER, frame + offset, n);
      offset += n;
      reply(USBIP_RET_SUBMIT, r.seqnum, 0, b, n + HEADER, n + HEADER);
      if (offset == length) { sending = 0; fid ^= 1; error_bit = 0; }
    }
  }
}

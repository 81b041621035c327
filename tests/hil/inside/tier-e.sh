# Every pixel format of vivid's webcam, then the multi-planar interface.
. /lib.sh
serial_on || exit 1
for planes in 1 2; do
  vivid_on input_types=0x0 multiplanar=$planes || exit 1
  # Bars of 100 %, the running counter in the upper left corner.
  vivid_control test_pattern=1; vivid_control osd_text_mode=1
  hydroline devices --json >/out/devices-e$planes.json 2>>/out/devices.stderr
  for name in $(cat /work/formats-$planes); do
    record "$name" "/work/rigs/$name.toml" 2
    recorded "$name" 20
  done
  rmmod vivid || exit 1
done
exit 0

#!/usr/bin/env bash
# The guest of tests/virtual_machine, in build/virtual_machine: Debian's kernel and an initramfs of the modules it needs.
# The kernel is unpacked, never installed. Needs apt sources of Debian, busybox-static, cpio and kmod.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
guest=$(cd "$here/../.." && pwd)/build/virtual_machine
modules=(
    virtio_pci 9pnet_virtio 9p        # this machine's own root
    evdev uinput uhid hid-generic hid-magicmouse
    dummy_hcd cdc_acm usb_f_acm       # a USB bus in memory, and a board on it
)

for tool in apt-get dpkg-deb busybox cpio depmod; do
    command -v "$tool" >/dev/null || { echo "no guest can be made here: $tool is missing." >&2; exit 1; }
done
package=$(apt-cache depends linux-image-amd64 2>/dev/null | awk '/Depends: linux-image-/ {print $2; exit}')
[ -n "$package" ] || { echo "no guest can be made here: apt knows no linux-image-amd64 (is this Debian?)." >&2; exit 1; }
release=${package#linux-image-}
release=${release%-unsigned}

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
chmod 755 "$work"
(cd "$work" && apt-get download -q -o APT::Sandbox::User=root "$package" && dpkg-deb -x "$package"_*.deb kernel)
[ -d "$work/kernel/lib/modules" ] || ln -s usr/lib "$work/kernel/lib"  # newer packages unpack below /usr
depmod -b "$work/kernel" "$release"

root=$work/root
mkdir -p "$root"/{bin,modules,host,dev,proc,sys}
install "$(command -v busybox)" "$root/bin/busybox"
install "$here/init.sh" "$root/init"
# In the order in which the kernel can take them; what is built in is not listed.
for module in "${modules[@]}"; do
    modprobe -d "$work/kernel" -S "$release" --show-depends "$module" | awk '$1 == "insmod" {print $2}'
done | awk '!seen[$0]++' | while read -r file; do
    name=$(basename "$file")
    case $file in
        *.xz) xz -dc "$file" >"$root/modules/${name%.xz}" ;;
        *) cp "$file" "$root/modules/$name" ;;
    esac
    echo "${name%.xz}" >>"$root/modules/order"
done

mkdir -p "$guest"
(cd "$root" && find . | cpio --quiet -o -H newc | gzip -1) >"$guest/initramfs.img"
# Unpacked, where it is packed by xz: QEMU would take 7 s to emulate that.
packed=$work/kernel/boot/vmlinuz-$release
begin=$(LC_ALL=C grep -obUaPm1 '\xfd7zXZ\x00' "$packed" | head -n 1 | cut -d : -f 1)
tail -c "+$((${begin:-0} + 1))" "$packed" | xz -dcq >"$guest/kernel" 2>/dev/null || true  # what follows is no xz
[ "$(head -c 4 "$guest/kernel")" = $'\x7fELF' ] || install -m 644 "$packed" "$guest/kernel"
echo "Linux $release with $(wc -l <"$root/modules/order") modules in $guest"

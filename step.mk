# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause

# $(call step,what it does: how long that takes,a command): the last lines of its output only if it fails. In the first,
# $(comma) is a comma.
comma := ,
LOG := $(VENV)/install.log
# On a terminal, the build shows there how far it is; see build_backend/extensions.py.
PROGRESS = if test -t 1; then export BUILD_PROGRESS=/dev/tty; fi
define step
@echo "$(1), see $(LOG)"
@$(PROGRESS); ($(2)) > $(LOG) 2>&1 || { tail -n 30 $(LOG); \
	echo "This step failed, $(LOG) has all of its output. The same make command tries it again."; exit 1; }
endef

# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause

# setup.bash, setup.sh and setup.zsh source this. It puts the folder of this project's packages before tf2, unless
# TF2_ROS_CYTHON=0; if a distribution has installed them, only if TF2_ROS_CYTHON=1.
# Only the folder of one Python exists; a pattern that matches nothing is an error in zsh.
if [ "${TF2_ROS_CYTHON-}" != 0 ]; then
  for _tf2_minor in 10 11 12 13 14 15 16; do
    _tf2_folder="${COLCON_CURRENT_PREFIX:-$AMENT_CURRENT_PREFIX}"
    _tf2_folder="$_tf2_folder/lib/python3.$_tf2_minor/site-packages/tf2_ros_cython"
    if [ -e "$_tf2_folder/opt_in" ] && [ "${TF2_ROS_CYTHON-}" != 1 ]; then
      continue
    fi
    _tf2_folder="$_tf2_folder/packages"
    if [ -d "$_tf2_folder" ]; then
      case ":${PYTHONPATH-}:" in
        *":$_tf2_folder:"*) ;;
        *) export PYTHONPATH="$_tf2_folder${PYTHONPATH:+:$PYTHONPATH}" ;;
      esac
    fi
  done
  unset _tf2_minor _tf2_folder
fi
